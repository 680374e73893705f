"""Flow sources: the velocity of every cell of a bird's-eye view, from two sweeps."""

from mottrack.core.interfaces import TableEntry

if __name__ != "mottrack.flow":
    raise ImportError("import mottrack.flow; the folder flow at the top is a link for reading")

FLOWS: dict[str, TableEntry] = {
    "zero": TableEntry(
        "mottrack.flow.zero:ZeroFlow",
        "No flow: marks the occupied cells, so that the tracker runs on positions alone.",
    ),
    "ground_truth": TableEntry(
        "mottrack.flow.ground_truth:GroundTruthFlow",
        "Velocity of each labelled object: the difference of its positions over the elapsed time.",
    ),
    "icp": TableEntry(
        "mottrack.flow.icp:IcpFlow",
        "Registration of each box's points to the previous, ego-aligned sweep.",
    ),
    "cluster_icp": TableEntry(
        "mottrack.flow.cluster_icp:ClusterIcpFlow",
        "Registration of each connected component from many starts.",
    ),
    "binary_ogm": TableEntry(
        "mottrack.flow.pillarflow.source:BinaryOgmFlow",
        "Learned flow of the one-channel network on binary occupancy (section IV-C).",
    ),
    "pillarflow": TableEntry(
        "mottrack.flow.pillarflow.source:PillarFlow",
        "Learned flow of the PillarFlow network, for every occupied cell.",
    ),
    "dogma": TableEntry(
        "mottrack.flow.dogma.source:DogmaFlow",
        "Dynamic occupancy grid: a particle filter over all sweeps of the scene.",
    ),
}
"""Name in a configuration to its class."""
