"""Plans a fleet: how many workers and gateways it needs, what it costs, and what breaks first.

    python3 deploy/fleet/plan                      # tables for 10, 100 and 1,000 robots
    python3 deploy/fleet/plan --check              # compares the simulation with closed forms
    python3 deploy/fleet/plan --profile gpu --set checkpoint.period_seconds=600

A discrete-event simulation: robots send frames, gateways check them, a log of three NATS nodes
keeps them, workers map and acknowledge them, write checkpoints, and die. All costs come from
costs.toml, which says where each is from. What comes out is no measurement. The same seed gives the
same numbers.
"""

import argparse
import sys
import tomllib
from pathlib import Path
from typing import Any

from check import check, tell_load_test
from costs import PROFILES, read_costs
from plot import svg
from report import plan_table, sweep_table
from search import plan_of, sweep


def change(text: str) -> tuple[str, Any]:
    name, _, value = text.partition("=")
    return name, tomllib.loads(f"value = {value}")["value"]


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="plan", description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--profile", choices=PROFILES, help="one profile only")
    add("--robots", default="10,100,1000", help="sizes of fleets (10,100,1000)")
    add("--seed", type=int, default=1)
    add("--set", action="append", default=[], type=change, help="SECTION.KEY=VALUE, in TOML")
    add("--svg", type=Path, help="write a plot of what breaks first")
    add("--markdown", action="store_true", help="tables in Markdown")
    add("--check", action="store_true", help="compare with closed forms and end")
    return parser.parse_args()


def main() -> int:
    options = arguments()
    profiles = [options.profile] if options.profile else PROFILES
    costs = {name: read_costs(name).changed(dict(options.set)) for name in PROFILES}
    if options.check:
        agrees = check(costs["gpu"])
        tell_load_test(costs["software"])
        return 0 if agrees else 1
    sizes = [int(size) for size in options.robots.split(",")]
    plans = {
        name: [plan_of(costs[name], robots, options.seed) for robots in sizes] for name in profiles
    }
    print(plan_table(plans, options.markdown), flush=True)
    for name in profiles:
        broken = sweep(costs[name], plans[name][-1], options.seed)
        print(f"\nProfile {name}, used shares of what is not scaled with the robots:\n")
        print(sweep_table(broken, options.markdown), flush=True)
        if options.svg:
            options.svg.write_text(svg(broken, f"What breaks first, profile {name}"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
