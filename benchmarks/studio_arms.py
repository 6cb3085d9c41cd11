"""Public arms in the studio: ``python -m benchmarks.studio_arms [--write docs/studio_arms.md]``.

Each arm of example-robot-data is packed into a .zip as it lies, and uploaded, drawn, moved, planned
for and played by the commands that the studio's page has: no file is edited. Where a tree has
several arms the tip is named, as in the page.
"""

import argparse
import json
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import viser

from armwright_client import ApiError, Client
from benchmarks.arms import UPLOADS
from benchmarks.example_arms import archive, package
from kinematics.urdf_visuals import read_visuals
from service.app import create_app
from service.settings import Settings
from studio.branch import Verdict
from studio.motion_frames import motion_frames
from studio.page.local_server import serve_page
from studio.page.studio_page import StudioPage
from studio.result import Failure, Planned
from studio.workbench import Workbench
from tests.service.server import serving

#: Goals tried for one that is free and can be planned to, drawn with this seed.
TRIES, SEED = 20, 0
#: Part of each joint's range that goals are drawn from, about the start.
SPREAD = 0.25
#: A service of the studio's own computes with so many workers.
WORKERS = 1
BEGIN, END = "<!-- studio arms: begin -->", "<!-- studio arms: end -->"


@dataclass(frozen=True)
class Row:
    """One arm in the studio.

    Args:
        name: Of the arm.
        joints: Of its chain.
        triangles: Of its collision geometry.
        looks: Links that are drawn by their visual meshes.
        shown: Time from the upload to the drawing [s].
        lint: Remarks about its description.
        branches: Configurations that reach the goal, valid and all.
        planner: That found the motion; empty where there is none.
        duration: Of the motion [s].
        frames: That play it.
        verified: Whether its certificate is complete.
        failure: Why there is no motion; empty where there is one.
    """

    name: str
    joints: int
    triangles: int
    looks: int
    shown: float
    lint: int
    branches: tuple[int, int]
    planner: str = ""
    duration: float = 0.0
    frames: int = 0
    verified: bool = False
    failure: str = ""


def show(page: StudioPage, name: str) -> Row:
    """Upload, draw, plan and play one arm.

    Args:
        page: Of the studio, in no browser.
        name: Of the arm.

    Raises:
        ApiError: The upload is refused.
    """
    workbench = page.workbench
    file_name = f"example_{name.lower().replace(' ', '_').replace(',', '')}.zip"
    began = time.perf_counter()
    urdf, fields = UPLOADS[name]
    workbench.upload_robot(file_name, archive(urdf), fields)
    page.rebuild()
    shown = time.perf_counter() - began
    meshes = workbench.geometry().bodies
    triangles = sum(len(body.triangles()) for body in meshes)
    looks = len({body.link for body in workbench.geometry("visual").bodies} & _seen(name))
    joints, lint = len(workbench.model.joint_names), len(workbench.model.lint)
    counts, outcome = _plan(workbench)
    row = Row(name, joints, triangles, looks, shown, lint, counts)
    if not isinstance(outcome, Planned):
        detail = outcome.detail if isinstance(outcome, Failure) else "no goal was free"
        return Row(**asdict(row) | {"failure": detail})
    page.show_outcome()
    frames = motion_frames(workbench, outcome)
    return Row(
        **asdict(row)
        | {
            "planner": outcome.plan.planner,
            "duration": outcome.plan.trajectory.duration,
            "frames": len(frames.times),
            "verified": outcome.plan.certificate.verified,
        }
    )


def _seen(name: str) -> set[str]:
    """Links with visual geometry in the description."""
    return set(read_visuals((package() / UPLOADS[name][0]).read_bytes()).links)


def _plan(workbench: Workbench) -> tuple[tuple[int, int], Planned | Failure | None]:
    """Goals about the start until one can be planned to: the branches of its pose, and the plan."""
    rng = np.random.default_rng(SEED)
    low, high = np.array(workbench.joint_ranges()).T
    counts, outcome = (0, 0), None
    for _ in range(TRIES):
        start, goal = (_draw(rng, low, high, workbench) for _ in range(2))
        if start is None or goal is None:
            continue
        workbench.set_start(start)
        workbench.set_goal_joints(goal)
        branches = workbench.move_goal(workbench.goal_tip())
        valid = [branch for branch in branches if branch.verdict is Verdict.VALID]
        counts = (len(valid), len(branches))
        found = workbench.plan()
        outcome = found if isinstance(found, Planned | Failure) else None
        if isinstance(outcome, Planned):
            break
    return counts, outcome


def _draw(
    rng: np.random.Generator,
    low: np.ndarray[tuple[int], np.dtype[np.float64]],
    high: np.ndarray[tuple[int], np.dtype[np.float64]],
    workbench: Workbench,
) -> list[float] | None:
    """A configuration that is free, if one of some draws is."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    for _ in range(TRIES):
        q = middle + SPREAD * 2.0 * half * rng.uniform(-1.0, 1.0, len(middle))
        joints = [float(value) for value in q]
        if workbench.client.check(workbench.state.robot, joints, depth=False).valid:
            return joints
    return None


def table(rows: list[Row]) -> str:
    """The rows as a table in Markdown."""
    names = "arm|joints|triangles|seen|shown after|remarks|branches|planned by|motion|frames|proved"
    lines = [f"| {' | '.join(names.split('|'))} |", "|---" * 11 + "|"]
    for row in rows:
        valid, count = row.branches
        motion = f"{row.duration:.2f} s" if row.planner else row.failure
        lines.append(
            f"| {row.name} | {row.joints} | {row.triangles:,} | {row.looks} | "
            f"{row.shown:.1f} s | {row.lint} | "
            f"{valid} of {count} | {row.planner or '–'} | {motion} | {row.frames} | "
            f"{'yes' if row.verified else 'no'} |"
        )
    done = sum(row.verified for row in rows)
    lines += ["", f"{done} of {len(rows)} arms are shown, planned for and played."]
    return "\n".join(lines)


def run(names: list[str], rows_file: Path | None) -> list[Row]:
    """Show the arms one after the other.

    Args:
        names: Of the arms.
        rows_file: JSON of rows: those in it are kept, and not measured again.
    """
    kept = json.loads(rows_file.read_text()) if rows_file and rows_file.is_file() else {}
    with tempfile.TemporaryDirectory() as folder:
        app = create_app(Settings(data_dir=Path(folder), workers=WORKERS))
        with serving(app) as http, Client(str(http.base_url)) as client:
            server: viser.ViserServer = serve_page(0)
            page = StudioPage(server, Workbench(client, str(http.base_url), "ur5e"))
            try:
                for name in names:
                    if name in kept:
                        continue
                    try:
                        kept[name] = asdict(show(page, name))
                    except ApiError as error:
                        print(f"{name}: {error}", flush=True)
                        continue
                    print(table([Row(**kept[name])]).splitlines()[2], flush=True)
                    if rows_file:
                        rows_file.write_text(json.dumps(kept))
            finally:
                page.close()
    return [Row(**kept[name]) for name in names if name in kept]


def main() -> None:
    """Show, print and perhaps write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", nargs="+", default=list(UPLOADS), choices=list(UPLOADS))
    parser.add_argument("--rows", type=Path, help="JSON of rows: kept, and not measured again")
    parser.add_argument("--write", type=Path, help="page whose table is replaced")
    given = parser.parse_args()
    rows = run(given.arms, given.rows)
    if given.write:
        text = given.write.read_text()
        before, after = text.split(BEGIN)[0], text.split(END)[1]
        given.write.write_text(f"{before}{BEGIN}\n{table(rows)}\n{END}{after}")
    else:
        print(table(rows))


if __name__ == "__main__":
    main()
