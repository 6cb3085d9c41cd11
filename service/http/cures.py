"""Cures of problems: what callers can do about each kind, beyond the hint of the occurrence."""

from collections.abc import Mapping

CURES: Mapping[str, str] = {
    "START_STATE_IN_COLLISION": (
        "Move the arm away from what `details.pair` names, or allow the pair if it may touch."
    ),
    "GOAL_IN_COLLISION": (
        "Move the goal, lower the margin, or allow the pair that `details.pair` names."
    ),
    "START_STATE_INVALID": (
        "Bring the joint that `details` names inside its limits, or raise `start_state_tolerance`."
    ),
    "GOAL_STATE_INVALID": "Choose a goal inside the joint limits that `details` names.",
    "START_STATE_VIOLATES_PATH_CONSTRAINTS": (
        "Start where the constraint holds, or widen its tolerance."
    ),
    "GOAL_VIOLATES_PATH_CONSTRAINTS": (
        "Choose a goal where the constraint holds, or widen its tolerance."
    ),
    "NO_IK_SOLUTION": (
        "Ask with `all_solutions` to see why candidates were rejected; loosen tolerances "
        "or free an axis."
    ),
    "PLANNING_FAILED": (
        "Read `details` for what is in the way; give more time, another planner or a "
        "smaller margin."
    ),
    "INVALID_MOTION_PLAN": (
        "Read which limit, constraint or pair is violated, and when; change the motion there."
    ),
    "TIMED_OUT": "Raise `timeout`, make the request smaller, or ask with `Prefer: respond-async`.",
    "PREEMPTED": (
        "The job was cancelled or its client left. Ask again if the answer is still wanted."
    ),
    "INVALID_GROUP_NAME": "Name a group of the robot's SRDF.",
    "INVALID_LINK_NAME": "Name one of the links that `GET /v1/robots/{name}` lists.",
    "INVALID_OBJECT_NAME": "Name an obstacle of the scene.",
    "INVALID_GOAL_CONSTRAINTS": "Correct the field that `detail` names.",
    "INVALID_ROBOT_STATE": "Give one number for each joint, in the order of `joint_names`.",
    "UNRECOGNIZED_GOAL_TYPE": "Give `joints`, `state`, `pose` or `any_of`.",
    "CRASH": "Ask again. If it happens again, report the request with the log of the service.",
    "INVALID_ROBOT_DESCRIPTION": "Correct the URDF, SRDF or table where `detail` says.",
    "INVALID_SCENE": "Correct the obstacle that `detail` names.",
    "MISSING_LIMIT": "Give the limit in `joint_limits`, or a rule in `default_limits`.",
    "MISSING_INERTIA": "Give masses and inertias of all links, or leave out what needs them.",
    "INVALID_REQUEST": "Change what `detail` names; the form of the request is right.",
    "VALIDATION_ERROR": "Correct the fields that `details.errors` lists; `/docs` has their form.",
    "IDEMPOTENCY_KEY_REUSED": "Take a new key for a new request.",
    "UNAUTHENTICATED": "Send an API key as `Authorization: Bearer aw_...` or `X-API-Key`.",
    "FORBIDDEN": "Ask with a key that has the scope which `detail` names; of a page, list its "
    "origin in `cors_origins`.",
    "QUOTA_EXCEEDED": "Delete robots, scenes or plans, or have the storage of the tenant raised.",
    "NOT_FOUND": "Check the name; lists such as `GET /v1/robots` show those there are.",
    "METHOD_NOT_ALLOWED": "Take a method that the header `Allow` names.",
    "REQUEST_TIMEOUT": "Send the body faster, or in fewer bytes.",
    "CONFLICT": "Choose another name, or wait until the other request has ended.",
    "PRECONDITION_FAILED": "Fetch what is there now, and send its new `ETag`.",
    "PAYLOAD_TOO_LARGE": "Send less, or have `ARMWRIGHT_MAX_BODY_SIZE` raised.",
    "UNSUPPORTED_MEDIA_TYPE": "Send `Content-Type: application/json`, or a form for an archive.",
    "HOST_NOT_ALLOWED": "Ask under an allowed name, or have it added to `ARMWRIGHT_ALLOWED_HOSTS`.",
    "OUT_OF_MEMORY": "Make the request smaller, or have `ARMWRIGHT_WORKER_MEMORY` raised.",
    "OVERLOADED": "Wait as long as `Retry-After` says, and ask again.",
    "NOT_READY": (
        "Wait as long as `Retry-After` says; kernels are being compiled, or workers start."
    ),
    "STORAGE_UNAVAILABLE": "Wait; the database is locked, full or away. The log says which.",
}
