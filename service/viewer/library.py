"""The page of a motion that was planned or proved in this process, without any request."""

from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.certificate import Certificate
from service.translate.certificates import certificate_answer
from service.version import VERSION
from service.viewer.document import motion_document, robot_document
from service.viewer.page import page
from service.viewer.words import certificate_sentences


def motion_page(
    motion: Trajectory, certificate: Certificate, robot: RobotGeometry, scene: Scene
) -> bytes:
    """The HTML page of a motion, UTF-8.

    Args:
        motion: The motion.
        certificate: Certificate of it, made here.
        robot: The robot with what it holds.
        scene: The obstacles.
    """
    return page(
        {
            "title": robot.chain.name,
            "id": None,
            "operation": "POST /v1/validate",
            "failed": False,
            "created": None,
            "version": VERSION,
            "seed": None,
            "digest": None,
            **robot_document(robot, scene),
            "motion": motion_document(motion, robot, scene, None),
            "configurations": [],
            "proved_here": certificate.verified,
            "sentences": certificate_sentences(certificate_answer(certificate)),
            "tree": None,
            "request": {},
        }
    )
