"""Run Waymo's official tracking metrics on arrays, as a process of its own.

    python waymo_evaluation.py IN.npz

IN has, for `truth` and `tracks`: box (N, 7), type, frame, sequence (numbers), id; `truth_level`,
`tracks_score`, `tracks_ignored`; and `cutoffs`. The last line printed is JSON: the name of each
breakdown to MOTA, MOTP, miss, mismatch and false positives.
"""

import json
import os
import sys

os.environ["TF_CPP_MIN_LOG_LEVEL"] = "3"

import numpy as np
import tensorflow as tf
from waymo_open_dataset import label_pb2
from waymo_open_dataset.metrics.ops import py_metrics_ops
from waymo_open_dataset.metrics.python import config_util_py
from waymo_open_dataset.protos import breakdown_pb2, metrics_pb2


def config(cutoffs):
    """The settings of the official command."""
    made = metrics_pb2.Config()
    for breakdown in (breakdown_pb2.Breakdown.OBJECT_TYPE, breakdown_pb2.Breakdown.RANGE):
        made.breakdown_generator_ids.append(breakdown)
        difficulty = made.difficulties.add()
        difficulty.levels.append(label_pb2.Label.LEVEL_1)
        difficulty.levels.append(label_pb2.Label.LEVEL_2)
    made.matcher_type = metrics_pb2.MatcherProto.TYPE_HUNGARIAN
    made.iou_thresholds.extend([0.0, 0.7, 0.5, 0.5, 0.5])
    made.box_type = label_pb2.Label.Box.TYPE_3D
    made.score_cutoffs.extend(cutoffs)
    return made


def main(path):
    with np.load(path) as content:
        a = dict(content)
    settings = config(a["cutoffs"].tolist())
    inputs = {"ground_truth": "truth", "prediction": "tracks"}
    tensors = {}
    for official, ours in inputs.items():
        tensors[f"{official}_bbox"] = tf.constant(a[f"{ours}_box"], tf.float32)
        tensors[f"{official}_type"] = tf.constant(a[f"{ours}_type"], tf.uint8)
        tensors[f"{official}_frame_id"] = tf.constant(a[f"{ours}_frame"], tf.int64)
        names = [str(s) for s in a[f"{ours}_sequence"].tolist()]
        tensors[f"{official}_sequence_id"] = tf.constant(names, tf.string)
        tensors[f"{official}_object_id"] = tf.constant(a[f"{ours}_id"], tf.int64)
    tensors["ground_truth_difficulty"] = tf.constant(a["truth_level"], tf.uint8)
    tensors["ground_truth_speed"] = tf.zeros((len(a["truth_box"]), 2), tf.float32)
    tensors["prediction_score"] = tf.constant(a["tracks_score"], tf.float32)
    tensors["prediction_overlap_nlz"] = tf.constant(a["tracks_ignored"], tf.bool)
    found = py_metrics_ops.tracking_metrics(config=settings.SerializeToString(), **tensors)
    names = config_util_py.get_breakdown_names_from_config(settings)
    columns = [column.numpy().tolist() for column in found[:6]]
    rows = dict(zip(names, zip(*columns, strict=True), strict=True))
    sys.stdout.write("\n" + json.dumps(rows) + "\n")


if __name__ == "__main__":
    main(sys.argv[1])
