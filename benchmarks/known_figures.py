"""Figures whose joints are known: smooth unions of capsules and blobs along posed chains of bones.

    python benchmarks/known_figures.py [KIND ...]   # kinds, or all: four minutes

Twelve kinds of bipeds in five poses and ten of quadrupeds in three. Every second kind was left out
while the recognition was written (`LEFT_OUT`). A figure stands with z up and looks along -y, so its
left is +x. A line for each figure: whether its kind was recognised, the names that are wrong, how
far joints are off (median and the farthest) and how far bones are from bones (both ways, mean), in
per cent of the height; then the same of the kinds in sight and of those left out.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import bodies
import medialis

CELL = 0.013
"""Cell of the grid, of the height: some 5000 vertices."""

BLEND = 0.007
"""Width of the rounding between parts, of the height."""


@dataclass(frozen=True)
class KnownFigure:
    """A figure and where its joints are.

    Attributes
    ----------
    name : str
        kind_pose.
    kind : {"biped", "quadruped"}
    shape : Shape
    bones : dict
        Head and tail of each bone; `thigh.L` is on the figure's own left.
    """

    name: str
    kind: str
    shape: medialis.Shape
    bones: dict[str, tuple[np.ndarray, np.ndarray]]

    @property
    def height(self) -> float:
        """The largest side of the box: what all distances are shares of."""
        return float(np.ptp(self.shape.points, axis=0).max())

    def changed(self, turn: np.ndarray, scale: float, points: np.ndarray | None) -> KnownFigure:
        """Return the figure turned and scaled, with other points of the same faces."""
        shape = self.shape
        at = shape.points if points is None else points
        assert shape.faces is not None
        bones = {name: (scale * turn @ a, scale * turn @ b) for name, (a, b) in self.bones.items()}
        return replace(
            self, shape=medialis.make_shape(scale * at @ turn.T, shape.faces), bones=bones
        )


@dataclass(frozen=True, kw_only=True)
class Biped:
    """Proportions of a biped, in heights of a person."""

    leg: float = 0.46
    trunk: float = 0.29
    neck: float = 0.07
    head: float = 0.15
    head_radius: float = 0.065
    shoulders: float = 0.105
    hips: float = 0.055
    arm: float = 0.31
    elbow: float = 0.54
    knee: float = 0.52
    hand: float = 0.09
    foot: float = 0.11
    limbs: float = 1.0
    body: float = 1.0
    fingers: int = 0
    tail: float = 0.0
    muscles: float = 0.15


BIPEDS = {
    "person": Biped(),
    "child": Biped(leg=0.38, trunk=0.28, head=0.22, head_radius=0.1, arm=0.26, neck=0.04),
    "heavy": Biped(body=1.7, limbs=1.4, hips=0.075, shoulders=0.13),
    "thin": Biped(body=0.75, limbs=0.65, muscles=0.3),
    "ape": Biped(leg=0.36, arm=0.42, body=1.35, limbs=1.25, shoulders=0.13, elbow=0.5, neck=0.05),
    "cartoon": Biped(
        leg=0.32, head=0.28, head_radius=0.14, limbs=0.75, hand=0.1, arm=0.25, trunk=0.25
    ),
    "dwarf": Biped(leg=0.28, trunk=0.3, body=1.6, limbs=1.5, arm=0.27, head=0.2, head_radius=0.09),
    "lizard_man": Biped(tail=0.45, leg=0.42, muscles=0.25),
    "five_fingers": Biped(fingers=5, hand=0.08),
    "three_fingers": Biped(fingers=3, limbs=1.15, hand=0.08, body=1.2),
    "athlete": Biped(body=1.25, shoulders=0.13, limbs=1.15, muscles=0.35, leg=0.49),
    "alien": Biped(
        leg=0.5, trunk=0.25, neck=0.11, head=0.2, head_radius=0.09, limbs=0.6, body=0.8, arm=0.38
    ),
}


@dataclass(frozen=True, kw_only=True)
class Quadruped:
    """Proportions of a quadruped, in heights of its back."""

    trunk: float = 0.95
    front: float = 0.75
    hind: float = 0.75
    chest: float = 0.19
    belly: float = 0.15
    neck: float = 0.35
    neck_rise: float = 50.0
    head: float = 0.3
    head_radius: float = 0.09
    limbs: float = 1.0
    width: float = 0.12
    tail: float = 0.45
    ears: float = 0.12
    sprawl: float = 0.0


QUADRUPEDS = {
    "dog": Quadruped(),
    "horse": Quadruped(trunk=1.05, neck=0.55, head=0.4, ears=0.08, tail=0.5),
    "cat": Quadruped(trunk=1.1, front=0.6, hind=0.65, tail=0.9, neck=0.22, head=0.18, limbs=0.85),
    "elephant": Quadruped(
        chest=0.3, belly=0.3, limbs=1.9, neck=0.2, head=0.3, head_radius=0.2, neck_rise=20, ears=0,
        tail=0.3, width=0.17,
    ),
    "giraffe": Quadruped(trunk=0.9, front=1.1, hind=1.0, neck=1.2, neck_rise=65, tail=0.4),
    "lizard": Quadruped(
        trunk=1.0, front=0.45, hind=0.5, sprawl=50, tail=1.2, neck=0.2, neck_rise=10, ears=0,
        chest=0.13, belly=0.14,
    ),
    "pig": Quadruped(trunk=1.0, front=0.45, hind=0.45, chest=0.24, belly=0.26, tail=0.12,
                     neck=0.22, neck_rise=15, limbs=1.1, width=0.14),
    "mouse": Quadruped(front=0.4, hind=0.42, tail=1.1, ears=0.2, neck=0.18, neck_rise=15,
                       limbs=0.7, belly=0.2),
    "bear": Quadruped(trunk=1.0, front=0.65, hind=0.6, limbs=1.7, chest=0.25, belly=0.25,
                      neck=0.25, neck_rise=25, tail=0.0, width=0.15),
    "deer": Quadruped(front=0.9, hind=0.9, limbs=0.7, neck=0.5, neck_rise=60, tail=0.15),
}  # fmt: skip

LEFT_OUT = (
    "child", "thin", "cartoon", "lizard_man", "three_fingers", "alien",
    "horse", "elephant", "lizard", "mouse", "deer",
)  # fmt: skip
"""Kinds that nobody looked at while the recognition was written."""

BIPED_POSES = ("t", "a", "bent", "walking", "reaching")
QUADRUPED_POSES = ("standing", "walking", "grazing")


@dataclass
class _Body:
    """Bones and capsules of a figure that is being made."""

    bones: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    parts: list[tuple[np.ndarray, np.ndarray, float, float]] = field(default_factory=list)

    def bone(
        self, name: str, head: np.ndarray, along: np.ndarray, radii: tuple[float, ...] = ()
    ) -> np.ndarray:
        """Add a bone with capsules of these radii along it; return its tail."""
        tail = head + along
        self.bones[name] = (head, tail)
        shares = np.linspace(0, 1, len(radii)) if len(radii) > 1 else np.zeros(0)
        for k in range(len(radii) - 1):
            a, b = head + shares[k] * along, head + shares[k + 1] * along
            self.parts.append((a, b, radii[k], radii[k + 1]))
        return tail

    def blob(self, at: np.ndarray, radius: float) -> None:
        """Add a ball."""
        self.parts.append((at, at + np.array([0, 0, 1e-6]), radius, radius))

    def shape(self, cell: float) -> medialis.Shape:
        """Surface the capsules."""
        return bodies.blended(self.parts, BLEND, cell)


def _way(side: float, down: float, forward: float) -> np.ndarray:
    """Return a unit vector: to the side (+x), down, forward (-y)."""
    v = np.array([side, -forward, -down], float)
    return v / np.linalg.norm(v)


def _swing(angle: float, out: float = 0.0) -> np.ndarray:
    """Return the way down, swung forward by an angle and out to the side by another (degrees)."""
    a, o = np.radians([angle, out])
    return np.array([np.sin(o), -np.sin(a) * np.cos(o), -np.cos(a) * np.cos(o)])


def _biped_pose(pose: str, sign: int) -> dict[str, np.ndarray]:
    """Return the directions of arm and leg of a side (+1 left), as of the left one."""
    leg = {"thigh": _swing(0, 3), "shin": _swing(-3, 3)}
    if pose == "t":
        return leg | {"upper_arm": _way(1, 0, 0), "forearm": _way(1, 0, 0.03)}
    if pose == "a":
        return leg | {"upper_arm": _way(1, 1, 0), "forearm": _way(1, 1.1, 0.06)}
    if pose == "bent":
        leg = {"thigh": _swing(35, 10), "shin": _swing(-35, 8)}
        return leg | {"upper_arm": _way(1, 0.5, 0), "forearm": _way(0.35, -0.6, 1)}
    if pose == "walking":
        thigh, shin, arm = (28, 10, -25) if sign > 0 else (-14, -50, 30)
        upper, fore = _swing(arm, 24), _swing(arm + 35, 14)
        return {"thigh": _swing(thigh, 2), "shin": _swing(shin, 2)} | {
            "upper_arm": upper, "forearm": fore,
        }  # fmt: skip
    if sign > 0:  # reaching
        arm = {"upper_arm": _way(0.5, -1, 0.3), "forearm": _way(0.1, -1, 0.3)}
    else:
        arm = {"upper_arm": _way(0.8, 0.3, 0.6), "forearm": _way(-0.2, 0, 1)}
    return {"thigh": _swing(12 * sign, 8), "shin": _swing(-14, 6)} | arm


def biped(kind: str, pose: str, proportions: Biped | None = None) -> KnownFigure:
    """Make a biped of a kind, or of other proportions."""
    p, body = proportions or BIPEDS[kind], _Body()
    lean = {"walking": 6.0, "bent": 10.0, "reaching": 4.0}.get(pose, 0.0)
    up = -_swing(-lean)
    t, m = 0.085 * p.body, 0.036 * p.limbs
    spine = body.bone("hips", np.zeros(3), 0.25 * p.trunk * up)
    chest = body.bone("spine", spine, 0.35 * p.trunk * up)
    neck = body.bone("chest", chest, 0.40 * p.trunk * up)
    head = body.bone("neck", neck, p.neck * up, (0.042 * min(p.limbs, 1.2), 0.036))
    body.bone("head", head, (p.head - 0.0) * up)
    body.blob(head + (p.head - p.head_radius) * up, p.head_radius)
    body.parts.append((head, head + (p.head - p.head_radius) * up, 0.04, p.head_radius))
    for x in (-0.5, 0.5):
        side = np.array([x * p.hips, 0, 0])
        body.parts.append((side, spine + 0.9 * side, t, 0.9 * t))
        wide = np.array([x * 0.9 * p.shoulders, 0, 0])
        body.parts.append((spine + 0.9 * side, chest + wide, 0.9 * t, t))
        body.parts.append((chest + wide, neck + wide - 0.03 * up, t, 0.7 * t))
    for sign, mark in ((1, ".L"), (-1, ".R")):
        flip = np.array([sign, 1, 1])
        ways = {name: flip * way for name, way in _biped_pose(pose, sign).items()}
        shoulder = neck + flip * [p.shoulders, 0, 0] - 0.035 * up
        body.bones["shoulder" + mark] = (neck, shoulder)
        body.parts.append((neck - 0.04 * up, shoulder, 0.05 * p.body, 1.25 * m))
        a, b = p.elbow * p.arm, (1 - p.elbow) * p.arm
        r = p.muscles
        elbow = body.bone("upper_arm" + mark, shoulder, a * ways["upper_arm"],
                          (1.2 * m, (1 + r) * m, 0.85 * m))  # fmt: skip
        wrist = body.bone("forearm" + mark, elbow, b * ways["forearm"],
                          (0.85 * m, (0.85 + r) * m, 0.62 * m))  # fmt: skip
        way = ways["forearm"]
        _hand(body, wrist, way, flip, p, mark)
        hip = flip * [p.hips + 0.01, 0, -0.02]
        body.bones["pelvis" + mark] = (np.zeros(3), hip)
        a, b = p.knee * p.leg, (1 - p.knee) * p.leg
        knee = body.bone("thigh" + mark, hip, a * ways["thigh"],
                         (1.9 * m, (1.7 + r) * m, 1.2 * m))  # fmt: skip
        ankle = body.bone("shin" + mark, knee, b * ways["shin"],
                          (1.2 * m, (1.15 + r) * m, 0.8 * m))  # fmt: skip
        ahead = _way(0.12 * sign, 0.35, 1)
        ball = body.bone("foot" + mark, ankle, 0.62 * p.foot * ahead, (0.85 * m, 0.75 * m))
        body.bone("toe" + mark, ball, 0.38 * p.foot * _way(0.1 * sign, 0, 1), (0.75 * m, 0.6 * m))
        body.parts.append((ankle, ankle + np.array([0, 0.01, -0.02]), 0.85 * m, 0.8 * m))
    if p.tail:
        back = np.array([0, 0.02, 0.0])
        first = body.bone("tail", back, 0.5 * p.tail * _way(0, 0.6, -1), (1.7 * m, 1.1 * m))
        body.bone("tail_2", first, 0.5 * p.tail * _way(0, 0.15, -1), (1.1 * m, 0.5 * m))
    return KnownFigure(f"{kind}_{pose}", "biped", body.shape(CELL), body.bones)


def _hand(
    body: _Body, wrist: np.ndarray, way: np.ndarray, flip: np.ndarray, p: Biped, mark: str
) -> None:
    """Add a hand, with fingers where there are any."""
    m = 0.036 * p.limbs
    if not p.fingers:
        body.bone("hand" + mark, wrist, p.hand * way, (0.7 * m, 0.85 * m, 0.6 * m))
        return
    palm = body.bone("hand" + mark, wrist, p.hand * way)
    across = np.cross(way, [0, 0, 1] if abs(way[2]) < 0.9 else [0, 1, 0])
    across *= np.sign(-across[1] if abs(across[1]) > 0.1 else across[0] * flip[0])
    across /= np.linalg.norm(across)
    body.parts.append((wrist, wrist + 0.7 * p.hand * way, 0.7 * m, 0.8 * m))
    places = np.linspace(-1, 1, p.fingers)
    for k, place in enumerate(places):
        root = wrist + (0.8 if k < p.fingers - 1 else 0.45) * p.hand * way
        root = root + 0.042 * place * across
        out = way + (0.35 if k < p.fingers - 1 else 0.9) * place * across
        out /= np.linalg.norm(out)
        size = 0.075 if k < p.fingers - 1 else 0.06
        body.bone(f"finger_{k}{mark}", root, size * out)
        body.parts.append((root, root + size * out, 0.013, 0.011))
        body.parts.append((wrist + 0.3 * p.hand * way, root, 0.018, 0.014))
    del palm


def _quadruped_legs(pose: str, sign: int, front: bool, reach: float) -> tuple[float, float, float]:
    """Return the swings of the three bones of a leg (degrees, forward); long legs swing less."""
    rest = (-12.0, 14.0, -2.0) if front else (22.0, -38.0, 12.0)
    if pose != "walking":
        return rest
    turn = 22.0 * min(1.0, 0.8 / reach) * sign * (1 if front else -1)
    return rest[0] + turn, rest[1] + turn - (10 if turn > 0 else 25), rest[2] + turn


def quadruped(kind: str, pose: str, proportions: Quadruped | None = None) -> KnownFigure:
    """Make a quadruped of a kind, or of other proportions."""
    p, body = proportions or QUADRUPEDS[kind], _Body()
    hips = np.array([0.0, p.trunk / 2, 0.0])
    ahead = np.array([0.0, -1.0, 0.0])
    third = p.trunk / 3
    a = body.bone("hips", hips, third * ahead, (0.9 * p.belly, p.belly))
    b = body.bone("spine", a, third * ahead, (p.belly, p.chest))
    c = body.bone("chest", b, third * ahead, (p.chest, 0.85 * p.chest))
    rise = np.radians(-35.0 if pose == "grazing" else p.neck_rise)
    m = 0.06 * p.limbs
    thick = max(1.3 * m, 0.6 * p.head_radius)
    d = body.bone("neck", c, p.neck * np.array([0, -np.cos(rise), np.sin(rise)]),
                  (0.55 * p.chest + thick / 2, thick))  # fmt: skip
    nod = np.radians(-70.0 if pose == "grazing" else min(p.neck_rise, 0) - 30)
    face = np.array([0, -np.cos(nod), np.sin(nod)])
    body.bone("head", d, p.head * face)
    body.blob(d + 0.15 * p.head * face, p.head_radius)
    body.parts.append((d + 0.15 * p.head * face, d + p.head * face - 0.05 * face,
                       p.head_radius, 0.05))  # fmt: skip
    crown = np.array([0, np.sin(nod), np.cos(nod)])
    for sign, mark in ((1, ".L"), (-1, ".R")):
        if p.ears:
            root = d + 0.6 * p.head_radius * np.array([sign, 0, 0]) + 0.5 * p.head_radius * crown
            way = 0.55 * np.array([sign, 0, 0]) + crown
            body.bone("ear" + mark, root, (p.ears + 0.5 * p.head_radius) * way / 1.14,
                      (0.03, 0.02))  # fmt: skip
        for front in (True, False):
            at, size = (c, p.front) if front else (hips, p.hind)
            words = (
                ("front_thigh", "front_shin", "front_foot") if front else ("thigh", "shin", "foot")
            )
            joint = at + np.array([sign * p.width, 0.05 if front else -0.03, -0.2 * p.belly])
            swings = _quadruped_legs(pose, sign, front, (p.front + p.hind) / 2 / p.trunk)
            shares, r = (0.42, 0.38, 0.20), 1.0 if front else 1.15
            widths = [(1.75 * r, 1.5 * r, 1.0), (1.0, 0.95, 0.7), (0.7, 0.72)]
            for k, (word, swing) in enumerate(zip(words, swings, strict=True)):
                out = sign * p.sprawl * (1.5, 0.35, 0.1)[k]
                joint = body.bone(word + mark, joint, shares[k] * size * _swing(swing, out),
                                  tuple(w * m for w in widths[k]))  # fmt: skip
                body.bone(("front_toe" if front else "toe") + mark, joint,
                      0.10 * _way(0, 0.1, 1), (0.75 * m, 0.6 * m))  # fmt: skip
    if p.tail:
        start = hips + np.array([0, 0.6 * p.belly, 0.3 * p.belly])
        body.bones["tail_root"] = (hips, start)
        first = body.bone("tail", start, 0.5 * p.tail * _way(0, 0.1, -1), (0.05, 0.04))
        body.bone("tail_2", first, 0.5 * p.tail * _way(0, -0.2, -1), (0.04, 0.025))
    return KnownFigure(f"{kind}_{pose}", "quadruped", body.shape(CELL * 1.5), body.bones)


def known_figures(kinds: tuple[str, ...] = ()) -> Iterator[KnownFigure]:
    """Yield the figures of these kinds in all poses; without kinds those in sight."""
    for kind in kinds or [k for k in (*BIPEDS, *QUADRUPEDS) if k not in LEFT_OUT]:
        if kind in BIPEDS:
            yield from (biped(kind, pose) for pose in BIPED_POSES)
        else:
            yield from (quadruped(kind, pose) for pose in QUADRUPED_POSES)


def drawn_figures(seed: int, bipeds: int = 20, quadrupeds: int = 10) -> Iterator[KnownFigure]:
    """Yield figures whose proportions are drawn between those of two kinds, each one by itself."""
    rng = np.random.default_rng(seed)

    def between(kinds: dict[str, Any]) -> Any:
        one, other = (kinds[name] for name in rng.choice(list(kinds), 2, replace=False))
        share = {f.name: rng.uniform() for f in fields(one)}
        mixed = {
            name: getattr(one, name) + s * (getattr(other, name) - getattr(one, name))
            for name, s in share.items()
        }
        return replace(one, **mixed | {"fingers": one.fingers} if "fingers" in mixed else mixed)

    for number in range(bipeds):
        pose = BIPED_POSES[number % len(BIPED_POSES)]
        yield biped(f"biped{number}", pose, between(BIPEDS))
    for number in range(quadrupeds):
        pose = QUADRUPED_POSES[number % len(QUADRUPED_POSES)]
        yield quadruped(f"quadruped{number}", pose, between(QUADRUPEDS))


@dataclass(frozen=True)
class Score:
    """How well the bones of a figure were found; distances in per cent of its height.

    `off` has the distance of each joint, `bent` of the elbows and knees that are bent.
    """

    name: str
    recognised: bool
    wrong: list[str]
    off: dict[str, float]
    bent: list[float]
    between_bones: float


def scored(figure: KnownFigure, rig: medialis.Bones) -> Score:
    """Compare bones with the truth."""
    scale = 100 / figure.height
    found = dict(zip(rig.names, zip(rig.heads, rig.tails, strict=True), strict=True))
    if not rig.kind:
        found = {}
    off: dict[str, float] = {}
    for name, joints in figure.bones.items():
        for which, word in enumerate(("head", "tail")):
            # Tails have other bones here than there.
            if name in found and not name.startswith("tail"):
                off[f"{name} {word}"] = float(np.linalg.norm(found[name][which] - joints[which]))
    bent = [off[f"{name} tail"] for name in _bent(figure) if name in found]
    wrong = [name for name in found if _misnamed(figure, found[name], name)]
    truth = _along(figure.bones.values())
    mine = _along(zip(rig.heads, rig.tails, strict=True))
    apart = np.linalg.norm(truth[:, None] - mine, axis=2)
    both = float(apart.min(axis=0).mean() + apart.min(axis=1).mean()) / 2
    off = {name: scale * apart for name, apart in off.items()}
    recognised = rig.kind == figure.kind
    return Score(figure.name, recognised, wrong, off, [scale * b for b in bent], scale * both)


def _along(bones: Iterable[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Return places along bones."""
    return np.concatenate([np.linspace(a, b, 20) for a, b in bones])


def _bent(figure: KnownFigure) -> Iterator[str]:
    """Yield upper arms and thighs whose elbow or knee is bent by more than 25 degrees."""
    for upper, lower in (("upper_arm", "forearm"), ("thigh", "shin")):
        for mark in (".L", ".R"):
            if upper + mark in figure.bones:
                one, other = (b - a for a, b in (figure.bones[w + mark] for w in (upper, lower)))
                cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
                if cosine < np.cos(np.radians(25)):
                    yield upper + mark


LIMBS = {"upper_arm": "arm", "forearm": "arm", "hand": "arm", "thigh": "leg", "shin": "leg",
         "foot": "leg", "toe": "leg", "front_thigh": "front", "front_shin": "front",
         "front_foot": "front", "front_toe": "front"}  # fmt: skip


def _misnamed(figure: KnownFigure, bone: tuple[np.ndarray, np.ndarray], name: str) -> bool:
    """Tell whether a bone of a limb lies nearer to another limb, or the other side's."""

    def limb(of: str) -> tuple[str, str]:
        word, _, mark = of.partition(".")
        return LIMBS.get(word, ""), mark

    def away(one: tuple[np.ndarray, np.ndarray]) -> float:
        (a, b), middle = one, (bone[0] + bone[1]) / 2
        share = np.clip((middle - a) @ (b - a) / max((b - a) @ (b - a), 1e-12), 0, 1)
        return float(np.linalg.norm(middle - a - share * (b - a)))

    if not limb(name)[0]:
        return False
    own = min(
        (away(one) for of, one in figure.bones.items() if limb(of) == limb(name)), default=9e9
    )
    other = min(away(one) for of, one in figure.bones.items()
                if limb(of)[0] and limb(of) != limb(name))  # fmt: skip
    return other < own and own > 0.03 * figure.height


def main(kinds: list[str]) -> None:
    """Score the figures of these kinds, or of all, and print the table."""
    scores: dict[str, list[Score]] = {"in sight": [], "left out": []}
    for kind in kinds or [*BIPEDS, *QUADRUPEDS]:
        for figure in known_figures((kind,)):
            score = scored(figure, medialis.run("armature", figure.shape).extras["bones"])
            scores["left out" if kind in LEFT_OUT else "in sight"].append(score)
            print_line(score.name, [score])
    for name, some in scores.items():
        if some:
            print_line(f"{name} ({len(some)})", some)


def print_line(name: str, scores: list[Score]) -> None:
    """Print what was found of some figures."""
    off = [x for score in scores for x in score.off.values()]
    told = "no joints"
    if off:
        told = f"joints {np.median(off):.2f}, 95 % {np.quantile(off, 0.95):.2f}, {max(off):.2f}"
    bent = [x <= 3 for score in scores for x in score.bent]
    wrong = sum(len(score.wrong) for score in scores)
    apart = np.mean([score.between_bones for score in scores])
    print(
        f"{name:24} recognised {sum(score.recognised for score in scores)}, wrong names {wrong}, "
        f"{told}, bones {apart:.2f}, bent joints within 3 %: {sum(bent)} of {len(bent)}",
        flush=True,
    )


if __name__ == "__main__":
    main(sys.argv[1:])
