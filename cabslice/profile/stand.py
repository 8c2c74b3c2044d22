"""What a process file may say of all that is printed beside and under the part: support, brim, raft."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cabslice.profile.printer import Table


class Tree(Table):
    """The branches of tree support."""

    branch_angle_deg: float = Field(default=40.0, ge=0, le=70, description="how far they lean from the vertical")
    tip_mm: float = Field(default=0.8, gt=0, le=100, description="how thick they end at the top; at least a bead")
    tip_distance_mm: float = Field(default=3.0, gt=0.1, le=1000, description="from tip to tip")
    taper_deg: float = Field(default=5.0, ge=0, le=45, description="slope of their sides: they grow thicker downwards")
    thickest_mm: float = Field(default=8.0, gt=0, le=1000, description="no branch is thicker than this")


class Support(Table):
    """Material that holds up what would otherwise be laid over air."""

    kind: Literal["none", "straight", "tree"] = Field(
        default="none", description="none; straight columns; or branches that meet on their way down")
    overhangs: Literal["all", "enforced"] = Field(
        default="all", description="which overhangs: all beyond angle_deg, or only what a --support-enforcer touches")
    where: Literal["everywhere", "bed"] = Field(
        default="everywhere", description="bed: only support that stands on the bed, none on the part")
    angle_deg: float = Field(
        default=50.0, ge=0, lt=90, description="surfaces that lean further than this from the vertical get support")
    bridge_mm: float = Field(
        default=8.0, ge=0, le=1000, description="bridges up to this long, held at both ends, get no support")
    smallest_mm2: float = Field(
        default=2.0, ge=0, le=1e6,
        description="overhangs that cover less get no support, unless nothing else holds them")
    xy_gap_mm: float = Field(default=0.5, ge=0, le=50, description="air between the part's sides and support")
    z_gap_mm: float = Field(
        default=0.2, ge=0, le=50, description="air over support, under the part; made of whole layers, rounded up")
    bottom_gap_mm: float = Field(
        default=0.2, ge=0, le=50, description="air under support that stands on the part; rounded up likewise")
    pattern: Literal["lines", "grid"] = Field(default="lines", description="how support is filled")
    density: float = Field(default=0.15, gt=0, le=1, description="share of support that is filled")
    line_angle_deg: float = Field(
        default=0.0, ge=-360, le=360, description="direction of its lines, from x; interface lines cross them")
    walls: int = Field(default=1, ge=0, le=20, description="loops around support, inside its edge")
    interface_layers: int = Field(
        default=2, ge=0, le=1000, description="denser layers at the top of support, under the part")
    bottom_interface_layers: int = Field(
        default=0, ge=0, le=1000, description="denser layers where support stands on the part")
    interface_density: float = Field(default=0.75, gt=0, le=1, description="share of those layers that is filled")
    tree: Tree = Tree()


class Brim(Table):
    """Loops on the bed along the edge of the first layer, and of support, so that it holds."""

    width_mm: float = Field(default=0.0, ge=0, le=500, description="how wide; rounded to whole loops; 0: none")
    gap_mm: float = Field(default=0.0, ge=0, le=20, description="air between the part and its brim")
    where: Literal["outside", "holes", "both"] = Field(default="outside", description="along which edges")


class Raft(Table):
    """Layers under the part that it is broken off from; the part, and its support, are lifted by them."""

    layers: int = Field(default=0, ge=0, le=100, description="layers of the raft, the first as high as first_layer_mm")
    interface_layers: int = Field(default=2, ge=0, le=100, description="how many of them, the topmost, are dense")
    gap_mm: float = Field(default=0.2, ge=0, le=20, description="air between raft and part")
    margin_mm: float = Field(default=3.0, ge=0, le=500, description="how far it reaches beyond the part and support")
    density: float = Field(default=0.4, gt=0, le=1, description="share of its lower layers that is filled")
    interface_density: float = Field(default=1.0, gt=0, le=1, description="share of its dense layers that is filled")


class Adaptive(Table):
    """Layers as thick as the slope of the surface beside them allows."""

    cusp_mm: float = Field(
        default=0.0, ge=0, le=5,
        description="how far steps between layers may stand off a sloping surface, square to it; 0: all layers alike")
    min_mm: float | None = Field(default=None, gt=0.01, le=5, description="thinnest layer; absent: half of layer_mm")
    max_mm: float | None = Field(default=None, gt=0.01, le=5, description="thickest layer; absent: layer_mm")


class Range(Table):
    """Other values between two heights; what is absent is as everywhere."""

    from_mm: float = Field(ge=0, le=1e6, description="height over the part's bottom from which they hold")
    to_mm: float = Field(gt=0, le=1e6, description="height up to which they hold")
    layer_mm: float | None = Field(default=None, gt=0.02, le=5, description="layer height, or less so that layers fit")
    walls: int | None = Field(default=None, ge=0, le=1000, description="number of walls")
    infill: float | None = Field(default=None, ge=0, le=1, description="share of the inside that is filled")
