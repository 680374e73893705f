"""Flow sources: the velocity of every cell of a bird's-eye view, from two sweeps."""

if __name__ != "mottrack.flow":
    raise ImportError("import mottrack.flow; the folder flow at the top is a link for reading")

FLOWS: dict[str, str] = {
    "zero": "mottrack.flow.zero:ZeroFlow",
    "ground_truth": "mottrack.flow.ground_truth:GroundTruthFlow",
    "icp": "mottrack.flow.icp:IcpFlow",
    "cluster_icp": "mottrack.flow.cluster_icp:ClusterIcpFlow",
    "binary_ogm": "mottrack.flow.pillarflow.source:BinaryOgmFlow",
    "pillarflow": "mottrack.flow.pillarflow.source:PillarFlow",
    "dogma": "mottrack.flow.dogma.source:DogmaFlow",
}
"""Name in a configuration -> `module:Class`; imported when asked for."""
