"""Names of the built-in robots, known without loading any of them."""

_NAMES = (
    "panda",
    "ur5e",
    "iiwa14",
    "kr6_sixx",
    "puma560",
    "scara",
    "stanford",
    "planar_rr",
    "cart_pendulum",
    "elbow_wrist",
)


def builtin_names() -> tuple[str, ...]:
    """Names of the robots that are always there."""
    return _NAMES
