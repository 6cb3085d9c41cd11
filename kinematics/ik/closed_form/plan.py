"""Arrays of a closed form: the arm as its kernels read it, and the candidates that they write.

A plan is an array of rows of 14 numbers. A frame in a row is laid out as in ``Chain.model``: one
number, then the frame's upper three rows.
"""

from typing import NamedTuple

from kinematics.arrays import Array
from kinematics.frame import Frame

#: Kinds of closed forms, by the number in a plan.
SPHERICAL = 0
THREE_PARALLEL = 1
REDUNDANT = 2

# Columns of a plan's first row, ``plan[HEADER]``.
HEADER = 0
#: Which kind of form.
KIND = 0
#: 1 where the form reads the joints from the tip.
REVERSED = 1
#: Index of the joint that is held at the parameter, -1 for none.
HELD = 2
#: Number of joints of the chain that take part.
JOINTS = 3
#: 0 where axes are special enough for the shorter way: axes 2 and 3 parallel before a spherical
#: wrist, or axes 5 and 6 meeting behind three parallel axes.
GENERAL = 4
#: How far the arm's axes are from the form [m or rad].
MISS = 5
#: Cosine of the turn that the offsets of joints 3 and 4 make about three parallel axes.
TURN_COSINE = 6
#: Sine of that turn.
TURN_SINE = 7

# Columns of the row of the form's joint j, ``plan[1 + j]``, around its offset.
#: 1, or -1 where the form counts the joint's angle the other way.
SIGN = 0
#: Index of the joint in the chain.
INDEX = 13

# Rows behind those of the joints.
#: The tip in the frame of the form's last joint.
TIP = 8
#: ``subproblem.wrist_constants`` of the last three joints.
WRIST = 9
#: The same of the first three joints of an arm with two spheres.
SHOULDER = 10
#: Type of the held joint, and its offset inverted.
LOCKED = 11
#: The tip in the frame of the joint before it, inverted.
LOCKED_TIP = 12
#: Rows in all.
ROWS = 13
#: Numbers in a row.
COLUMNS = 14

# Columns of a candidate, behind the cosines and sines of seven angles.
#: Its branch, in bits.
BRANCH = 14
#: Number of the family that it stands for, 0 where it is alone.
FAMILY = 15
#: Parameter of a redundant arm.
PARAMETER = 16
#: Numbers of a candidate.
WIDTH = 17


class Arm(NamedTuple):
    """A chain up to a link, with the closed form that it has or nearly has.

    Args:
        plan: The closed form, as ``structure`` packs it, shape (ROWS, COLUMNS).
        model: ``Chain.model``.
        link: Number of the link to bring to a pose.
        lower: Lower limits, shape (n,) [rad or m].
        upper: Upper limits, shape (n,) [rad or m].
    """

    plan: Array
    model: Array
    link: int
    lower: Array
    upper: Array


class Problem(NamedTuple):
    """A pose that the link of an arm is to be brought to.

    Args:
        arm: The arm.
        T: The pose T_base_link.
        seed: Configuration that whole turns and free angles are to be near, shape (n,).
        tolerance: Largest error of a solution [m], [rad].
    """

    arm: Arm
    T: Frame
    seed: Array
    tolerance: float


class CandidateTable(NamedTuple):
    """Candidates of a form for one pose, and what they are made from.

    Args:
        free: Angles to try where a pose leaves them free, that of the seed first, by the form's
            joints, shape (k, 6 or 7) [rad].
        slack: Lengths and squares out of range by no more than this are cut [m or m^2].
        rows: The candidates: cosine and sine of each angle by the form's joints, then the columns
            named above, shape (r, WIDTH).
    """

    free: Array
    slack: float
    rows: Array
