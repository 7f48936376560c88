"""`python -m smv_planner` is `smv-planner`."""

from smv_planner.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
