"""Tours over many goals."""

from fastapi import Request, Response

from armwright_wire.plans.tour import TourAnswer, TourRequest
from service.http import answers
from service.http.json_route import json_router
from service.task_references import tour as tour_task

router = json_router("planning")


@router.post("/tours", summary="Visit many goals in the best order", response_model=TourAnswer)
async def tour(body: TourRequest, request: Request) -> Response:
    """Order, configurations and proved motions of a tour over 2 to 500 goals.

    The search goes by the times of straight motions; only legs that a tour takes are planned and
    proved, and where one takes longer the order is searched again. The shortest tour proved before
    the deadline is answered, with a bound that no tour beats.
    """
    return await answers.respond(request, tour_task.job, body.robot, body)
