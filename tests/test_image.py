"""The image and the station of containers, by their texts; the build itself takes minutes."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from smv_planner import language
from smv_planner.cli import main

ROOT = Path(__file__).parents[1]


def stages() -> list[list[tuple[str, str]]]:
    """Instructions with their arguments, by stage; what stands before the first FROM comes first."""
    text = re.sub(r"^\s*#.*\n", "", (ROOT / "Dockerfile").read_text(), flags=re.M).replace("\\\n", " ")
    found: list[list[tuple[str, str]]] = [[]]
    for line in filter(str.strip, text.splitlines()):
        word, _, rest = line.partition(" ")
        if word == "FROM":
            found.append([])
        found[-1].append((word, rest.strip()))
    return found


def last(word: str) -> str:
    """What an instruction of the last stage says."""
    (said,) = (rest for found, rest in stages()[-1] if found == word)
    return said


def services() -> dict[str, dict[str, Any]]:
    text = re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", (ROOT / "compose.yaml").read_text())
    found: dict[str, dict[str, Any]] = yaml.safe_load(text)["services"]
    return found


def test_the_base_is_a_version_and_may_be_a_digest() -> None:
    before, *built = stages()
    (base,) = (rest.removeprefix("BASE=") for word, rest in before if rest.startswith("BASE="))
    assert re.fullmatch(r".+:\d\S+", base), "a tag that says which Python"
    assert {rest.split(" AS ")[0] for stage in built for word, rest in stage if word == "FROM"} == {
        "${BASE}${BASE_DIGEST:+@${BASE_DIGEST}}"
    }


def test_what_runs_is_copied_and_has_no_compiler() -> None:
    *_, builder, final = stages()
    assert any("apt-get" in rest for word, rest in builder if word == "RUN")
    assert [rest for word, rest in final if word == "COPY"] == ["--from=builder /opt/smv_planner /opt/smv_planner"]
    assert not [rest for word, rest in final if word == "RUN" and re.search(r"apt|pip|gcc|make", rest)]


def test_what_runs_is_nobody_in_particular() -> None:
    user, group = last("USER").split(":")
    assert int(user) > 0
    assert int(group) > 0
    assert f"-o {user} -g {group}" in last("RUN"), "the journal's folder is theirs"
    assert last("VOLUME") in last("RUN")


def test_the_image_is_the_daemon_and_says_how_it_is() -> None:
    program, *arguments = json.loads(last("CMD"))
    asked = main.parser().parse_args(arguments)
    assert (program, asked.command) == ("smv-planner", "run")
    _, exec_form = last("HEALTHCHECK").split(" CMD ")
    program, *arguments = json.loads(exec_form)
    assert (program, main.parser().parse_args(arguments).command) == ("smv-planner", "health")


def test_all_that_the_package_is_made_of_gets_into_the_image() -> None:
    packages = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    copied = {word for stage in stages() for name, rest in stage if name == "COPY" for word in rest.split()[:-1]}
    ignored, *let_in = [line for line in (ROOT / ".dockerignore").read_text().split() if re.match(r"!|\*$", line)]
    assert ignored == "*"
    for name in (*packages, "scenarios", "pyproject.toml", "README.md", "LICENSE"):
        assert name in copied
        assert f"!{name}" in let_in
        assert (ROOT / name).exists()


@pytest.mark.parametrize("name", services())
def test_a_service_can_write_nothing_and_reach_nobody(name: str) -> None:
    service = services()[name]
    assert service["read_only"]
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert service["network_mode"] == ("none" if name == "loopback" else "service:loopback")
    assert "ports" not in service


def test_the_services_are_commands_that_there_are() -> None:
    commands = {name: service["command"] for name, service in services().items() if name != "loopback"}
    asked = {name: main.parser().parse_args(words[1:]) for name, words in commands.items()}
    assert {each.command for each in asked.values()} == {"router", "run", "emulate", "operator"}
    (scenario,) = {each.scenario for each in asked.values() if "scenario" in each}
    assert language.load(ROOT / scenario).name


@pytest.mark.long
def test_the_image_is_built_and_works() -> None:
    docker = shutil.which("docker") and subprocess.run(["docker", "info"], capture_output=True).returncode == 0
    if not docker and not shutil.which("podman") and os.getuid() != 0:
        pytest.skip("there is neither a docker that answers nor podman, and only root can install one")
    done = subprocess.run([ROOT / "container/image.sh"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-4000:]
    assert "door: reached in 5 steps" in done.stdout
    assert "nusmv agrees" in done.stdout
