"""`smv-planner router`: an embedded Zenoh router."""

from __future__ import annotations

import argparse

from bridge.endpoints import LOOPBACK
from bridge.router import RouterConfig, router
from smv_planner.cli import outcome
from smv_planner.cli.network import add_security, tls, until_interrupted


def add_router(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--listen", metavar="ENDPOINT", action="append", default=[], help=f"where to listen; repeatable (default: {LOOPBACK})"
    )
    group = parser.add_argument_group("security")
    group.add_argument("--access-control", metavar="FILE", help="as 'smv-planner security acl' writes it")
    add_security(group)


def run_router(asked: argparse.Namespace) -> int:
    listen = tuple(asked.listen) or (LOOPBACK,)
    with router(RouterConfig(listen, tls(asked), asked.access_control, asked.insecure_lan)):
        print(f"router at {', '.join(listen)}", flush=True)
        until_interrupted()
    return outcome.REACHED
