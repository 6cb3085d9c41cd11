"""The tools for language models, called by the SDK's own client against a served application."""

import asyncio
import json
import os
import sys
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import pytest
from mcp import Client, MCPError, StdioServerParameters

import command_line.commands.studio
from armwright_client import AsyncClient
from command_line.mcp_server import mcp_server
from service.app import create_app
from service.settings import Settings
from tests.command_line.commands import Run
from tests.service.robots import ASIDE, POST
from tests.service.server import serving

READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
ABOUT_POST = {"obstacles": [POST]}
TOOLS = {"list_robots", "describe_scene", "check", "plan", "task", "validate", "explain", "view"}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    app = create_app(Settings(data_dir=tmp_path_factory.mktemp("mcp"), workers=1))
    with serving(app) as client:
        assert client.post("/v1/scenes", json={"name": "posts", **ABOUT_POST}).is_success
        yield client


@pytest.fixture
def url(service: httpx.Client) -> str:
    return str(service.base_url)


class Session:
    """Calls of one client of the tools."""

    def __init__(self, client: Client) -> None:
        self.client = client

    async def __call__(self, tool: str, **arguments: Any) -> Any:
        result: Any = await self.client.call_tool(tool, arguments)
        assert not result.is_error, result.content
        return result.structured_content

    async def refusal(self, tool: str, **arguments: Any) -> str:
        result: Any = await self.client.call_tool(tool, arguments)
        assert result.is_error
        return str(result.content[0].text)


def talk(url: str, conversation: Callable[[Session], Any]) -> None:
    """Have a conversation with the tools of a service, in this process."""

    async def run() -> None:
        async with AsyncClient(url) as there, Client(mcp_server(there, url)) as client:
            await conversation(Session(client))

    asyncio.run(run())


def test_a_plan_is_made_explained_shown_and_proved_again(url: str, service: httpx.Client) -> None:
    async def conversation(call: Session) -> None:
        robots = await call("list_robots", robot="panda")
        assert {"panda", "ur5e"} <= set(robots["robots"])
        assert robots["states"]["home"]
        assert (await call("describe_scene"))["scenes"] == ["posts"]
        (post,) = (await call("describe_scene", scene="posts"))["obstacles"]
        assert post.startswith(f"{POST['id']}: ")

        plan = await call("plan", robot="panda", start="home", goal=list(ASIDE), scene="posts")
        assert plan["proved"]
        kept = service.get(f"/v1/plans/{plan['plan_id']}").json()
        assert kept["answer"]["trajectory"]["duration"] == pytest.approx(plan["duration"], abs=1e-4)
        assert plan["end"] == pytest.approx(list(ASIDE))
        assert len(json.dumps(plan)) < 2_000 < len(json.dumps(kept)), "answers are small"

        why = await call("explain", plan_id=plan["plan_id"])
        assert why["scene"] == "posts"
        assert plan["says"][0] in why["says"]

        again = await call("validate", motion=plan["plan_id"])
        assert again["proved"]
        wide = await call("validate", motion=plan["plan_id"], margin=1.0)
        assert not wide["proved"]
        assert any("First violation" in line for line in wide["says"])

        view: Any = await call.client.call_tool("view", {"plan_id": plan["plan_id"]})
        text, link = view.content
        assert httpx.get(text.text.split()[1]).text.startswith("<!doctype html>")
        page: Any = await call.client.read_resource(link.uri)
        assert page.contents[0].text.startswith("<!doctype html>")
        data: Any = await call.client.read_resource(plan["data"])
        assert json.loads(data.contents[0].text)["answer"] == kept["answer"]

    talk(url, conversation)


def test_goals_are_states_poses_and_what_the_interface_takes(url: str) -> None:
    tip = {"position": [0.4, 0.1, 0.5], "rpy": [3.14159265, 0.0, 0.0]}

    async def conversation(call: Session) -> None:
        for goal in ("home", tip, {"pose": tip, "position_tolerance": 0.001}):
            plan = await call("plan", robot="panda", start=READY, goal=goal)
            assert plan["proved"], goal
        check = await call("check", robot="panda", joints=plan["end"])
        assert check["valid"]
        assert not (await call("check", robot="panda", joints=[9.0] * 7))["valid"]
        inside = await call("check", robot="panda", joints="home", scene="posts", margin=5.0)
        assert not inside["valid"]

    talk(url, conversation)


def test_a_task_tells_of_its_stages(url: str) -> None:
    stages = [{"kind": "move", "goal": {"state": "home"}}, {"kind": "wait", "duration": 1.5}]

    async def conversation(call: Session) -> None:
        task = await call("task", robot="panda", start=READY, stages=stages)
        assert task["proved"]
        assert [line.split(":")[0] for line in task["says"]] == ["0 move", "1 wait"]
        assert task["duration"] > 1.5
        why = await call("explain", plan_id=task["plan_id"])
        assert why["says"][1:] == task["says"]
        refused = await call.refusal("validate", motion=task["plan_id"])
        assert "explain" in refused

    talk(url, conversation)


def test_what_fails_is_said_with_its_cure_and_kept(url: str) -> None:
    async def conversation(call: Session) -> None:
        goal = {"position": [5.0, 0.0, 0.5], "rpy": [3.14, 0, 0]}
        text = await call.refusal("plan", robot="panda", start="home", goal=goal)
        kept = text.partition("plan_id ")[2].split(".")[0]
        why = await call("explain", plan_id=kept)
        assert why["status"] == "failed"
        assert all(line in text for line in why["says"])
        assert "bender" in await call.refusal("list_robots", robot="bender")
        assert "it has: " in await call.refusal("check", robot="panda", joints="kneeling")
        twice = {"margin": 0.1}
        text = await call.refusal("plan", robot="panda", start="home", goal="home", options=twice)
        assert "margin" in text
        text = await call.refusal("task", robot="panda", start="home", stages=[{"kind": "dance"}])
        assert "dance" in text
        assert "no_such" in await call.refusal("explain", plan_id="no_such")
        with pytest.raises(MCPError, match="no_such"):
            await call.client.read_resource("armwright://plans/no_such")

    talk(url, conversation)


def test_a_service_that_is_not_there_is_told_with_the_remedy() -> None:
    async def conversation(call: Session) -> None:
        assert "armwright serve" in await call.refusal("list_robots")

    talk("http://127.0.0.1:9", conversation)


def test_the_list_of_tools_is_short_and_says_which_of_them_only_read(url: str) -> None:
    async def conversation(call: Session) -> None:
        listed: Any = await call.client.list_tools()
        tools = listed.tools
        assert {tool.name for tool in tools} == TOOLS
        keeping = {tool.name for tool in tools if not tool.annotations.read_only_hint}
        assert keeping == {"plan", "task", "validate"}
        assert all(tool.description for tool in tools)
        assert len(json.dumps([tool.model_dump(mode="json") for tool in tools])) < 16_000

    talk(url, conversation)


def test_the_command_serves_them_over_standard_input_and_output(url: str) -> None:
    command = ["-m", "command_line.main", "mcp", "--url", url]

    async def run() -> None:
        parameters = StdioServerParameters(
            command=sys.executable, args=command, env=dict(os.environ)
        )
        async with Client(parameters) as client:
            assert "armwright://plans/" in str(client.instructions)
            answer = await Session(client)("list_robots")
            assert "panda" in answer["robots"]

    asyncio.run(run())


def test_missing_packages_are_named_with_the_extra(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(command_line.commands.studio._NEEDED, "mcp", ("no_such_package",))
    refused = run("mcp")
    assert refused.code == 3
    assert "no_such_package" in refused.err
    assert "[mcp]" in refused.err
    monkeypatch.undo()
    assert "base URL" in run("mcp", "--url", "nowhere").err
