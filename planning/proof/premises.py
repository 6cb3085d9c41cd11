"""Premises of a proof: the robot, the surroundings and the margin that it was carried out for.

A proof says nothing of another robot, another scene or another load. Hashes are of contents: the
same scene has the same hash whether it is stored, in a file or in a request.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from kinematics.caches.bounded_cache import array_bytes, bounded_cache
from kinematics.model.chain import Chain
from obstacles.robots.allowed_pairs import allowed_pairs
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.collision.containment import open_meshes

#: Digits of a hash that texts show.
_DIGITS = 12


@dataclass(frozen=True, slots=True)
class Premises:
    """Premises of a certificate.

    Args:
        robot: Name of the robot; None where limits were given without one.
        robot_hash: Hash of the robot with what it holds and its fingers where they stand; of its
            chain alone where collisions were not looked at; None without a robot.
        scene: Name of the stored scene; None of any other.
        scene_hash: Hash of the obstacles that are not held and of the pairs that may touch;
            None where collisions were not looked at.
        obstacles: How many these obstacles are.
        attached: Names of the objects that the robot holds.
        tool: The link whose frame poses of the tool are of; None without a robot.
        margin: Distance kept from obstacles beyond their own margins [m].
        open_meshes: Meshes taken as open, whose inside is not solid, by name.
    """

    robot: str | None = None
    robot_hash: str | None = None
    scene: str | None = None
    scene_hash: str | None = None
    obstacles: int = 0
    attached: tuple[str, ...] = ()
    tool: str | None = None
    margin: float = 0.0
    open_meshes: tuple[str, ...] = ()

    @classmethod
    @bounded_cache(maxsize=16, weigh=array_bytes)
    def of_cell(cls, robot: RobotGeometry, scene: Scene, margin: float) -> "Premises":
        """Premises of a proof that nothing collides.

        Args:
            robot: The arm with its geometry and what it holds.
            scene: The obstacles.
            margin: Distance kept from obstacles beyond their own margins [m].
        """
        chain = robot.chain
        pairs = {item.pair for item in allowed_pairs(robot, scene)} - robot.allowed.keys()
        return cls(
            robot=chain.name,
            robot_hash=robot.content_hash,
            scene_hash=scene.hash_allowing(pairs),
            obstacles=len(scene.obstacles),
            attached=tuple(name for name in robot.names if name not in chain.index),
            tool=chain.tip_link,
            margin=margin,
            open_meshes=open_meshes(robot, scene),
        )

    @classmethod
    def of_limits(cls, chain: Chain | None) -> "Premises":
        """Premises of a proof of limits alone, with or without a robot."""
        if chain is None:
            return cls()
        return cls(robot=chain.name, robot_hash=chain.content_hash, tool=chain.tip_link)

    @classmethod
    def of_fields(cls, told: Mapping[str, Any]) -> "Premises":
        """Premises from their fields as answers tell them; what other versions add is left out."""
        known = {name: told[name] for name in cls.__slots__ if name in told}
        lists = {name: tuple(known.get(name) or ()) for name in ("attached", "open_meshes")}
        return cls(**known | lists)

    def against(self) -> str:
        """The premises in words, to stand behind "proved"."""
        if self.robot is None or self.robot_hash is None:
            return "against the given limits only, without a robot"
        robot = f"robot {self.robot} (hash {self.robot_hash[:_DIGITS]}), tool {self.tool}"
        if self.scene_hash is None:
            return f"against the limits of the robot only, collisions not looked at: {robot}"
        if self.attached:
            robot += f", holding {', '.join(self.attached)}"
        if self.open_meshes:
            robot += f", meshes taken as open: {', '.join(self.open_meshes)}"
        if not self.obstacles:
            return f"against the robot itself only, without obstacles: {robot}"
        scene = "a scene" if self.scene is None else f"scene {self.scene}"
        count = f"{self.obstacles} obstacle{'' if self.obstacles == 1 else 's'}"
        hashed = f"hash {self.scene_hash[:_DIGITS]}"
        return f"against {scene} of {count} ({hashed}), margin {self.margin:g} m, and {robot}"

    def differences(self, given: "Premises") -> list[str]:
        """In which respects other premises differ, a sentence each; margins and names do not count.

        Args:
            given: Premises of the motion as it was proved before.
        """
        if given.scene_hash is None:  # of limits alone
            other = given.robot is not None and given.robot != self.robot
            return [f"its limits are those of robot {given.robot!r}"] if other else []
        found = []
        if given.attached != self.attached:
            held, here = (", ".join(one.attached) or "nothing" for one in (given, self))
            found.append(f"its proof has the robot hold {held}, here it holds {here}")
        elif given.robot_hash != self.robot_hash:
            found.append(
                f"its proof is of a robot {given.robot!r} of another hash: the robot, its fingers "
                "or what it holds differs"
            )
        if given.obstacles != self.obstacles:
            found.append(
                f"its proof is against {given.obstacles} obstacle(s), here are {self.obstacles}"
            )
        elif given.scene_hash != self.scene_hash:
            found.append("its proof is against other obstacles, or other pairs may touch")
        return found
