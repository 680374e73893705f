"""One process or many: the same trainer under `torchrun`."""

from __future__ import annotations

import os
from dataclasses import dataclass

import torch
from torch import distributed


@dataclass(frozen=True)
class Place:
    """This process among its peers."""

    rank: int
    """0 writes the files."""
    size: int
    """Number of processes."""
    device: torch.device
    """Where its network lives."""

    @property
    def first(self) -> bool:
        """Whether this process writes."""
        return self.rank == 0


def join() -> Place:
    """Join the group that `torchrun` describes in the environment, or stand alone."""
    rank, size = int(os.environ.get("RANK", 0)), int(os.environ.get("WORLD_SIZE", 1))
    local = int(os.environ.get("LOCAL_RANK", 0))
    cuda = torch.cuda.is_available()
    device = torch.device("cuda", local) if cuda else torch.device("cpu")
    if cuda:
        torch.cuda.set_device(device)
    if size > 1 and not distributed.is_initialized():
        distributed.init_process_group("nccl" if cuda else "gloo")
    return Place(rank, size, device)


def leave(place: Place) -> None:
    """Close the group."""
    if place.size > 1 and distributed.is_initialized():
        distributed.destroy_process_group()
