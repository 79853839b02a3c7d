"""The tables of PLAN.md."""

import math
from collections.abc import Sequence

from maps import mean_checkpoint
from search import Plan, Sweep
from simulation import quantile

MEGA, GIGA, TERA, HOUR, DAY, MONTH = 1e6, 1e9, 1e12, 3600.0, 86400.0, 30.4 * 86400


def table(rows: Sequence[Sequence[str]], markdown: bool) -> str:
    """Rows of text under each other; the first one is the head."""
    if markdown:
        head, *others = ["| " + " | ".join(row) + " |" for row in rows]
        return "\n".join([head, "|---" * len(rows[0]) + "|", *others])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    padded = [map(str.ljust, row, widths) for row in rows]
    return "\n".join("  ".join(row).rstrip() for row in padded)


def short(value: float) -> str:
    """Two or three digits that matter."""
    if math.isnan(value):
        return "-"
    if value >= 1000:
        return f"{float(f'{value:.3g}'):,.0f}"
    return f"{value:.0f}" if value >= 100 else f"{value:.2g}"


def shorts(*values: float, before: str = "") -> str:
    return ", ".join(before + short(value) for value in values)


def percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def disk_per_day(plan: Plan) -> tuple[float, float]:
    """Bytes that all nodes keep of one day, if nothing is ever trimmed, and if frames are."""
    costs = plan.costs
    robots = costs.robots
    sessions = plan.robots * DAY / (robots.session_seconds + robots.pause_seconds)
    kept = sessions * mean_checkpoint(costs)[0] * costs.nats.replicas
    frames = plan.usual.frame_rate * robots.frame_bytes * DAY * costs.nats.replicas
    return frames + kept, kept


def cost_per_robot_hour(plan: Plan, disk: float) -> float:
    """Dollars, if so many bytes are kept of each day."""
    costs = plan.costs
    price, worker, nats = costs.price, costs.worker, costs.nats
    # The price of a GPU has the cores beside it.
    cores = plan.gateways * costs.gateway.cores + nats.nodes * nats.cores
    cores += 0 if worker.gpus else plan.workers * worker.cores
    machines = plan.workers * worker.gpus * price.gpu_hour + cores * price.core_hour
    kept = disk * price.keep_days / TERA * price.terabyte_month * HOUR / MONTH
    traffic = plan.usual.traffic().between * HOUR / GIGA * price.gigabyte_between
    return (machines + kept + traffic) / plan.robots


def column_of(name: str, plan: Plan) -> dict[str, str]:
    """A plan as a column of the table."""
    usual, failures = plan.usual, plan.failures
    traffic, disk = usual.traffic(), disk_per_day(plan)
    more, away = "≥ " if failures.homeless else "", failures.seconds_away()
    late = failures.delayed / max(1, failures.deaths)
    return {
        "profile, robots": f"{name}, {plan.robots:,}",
        "workers, of them spare": f"{plan.workers:,}, {plan.spare}" + ("" if plan.fits else " ¹"),
        "gateways": str(plan.gateways),
        "acknowledgement p50, p99, s": shorts(usual.p50, usual.p99),
        "devices busy: frames and questions, optimiser": (
            f"{percent(usual.device_share)}, {percent(usual.behind_share)}"
        ),
        "optimiser steps taken of those earned": percent(usual.optimiser_share),
        "fullest worker's memory": percent(usual.memory_share),
        "gateways' processors busy": percent(usual.gateway_share),
        "NATS in, between, out, MB/s": shorts(
            traffic.into / MEGA, traffic.between / MEGA, traffic.out / MEGA
        ),
        "fsyncs of a node, 1/s": short(usual.syncs),
        "disk, `trim` never, checkpoint, TB/day": shorts(disk[0] / TERA, disk[1] / TERA),
        "newest checkpoint's age, mean, s": short(usual.replay_seconds),
        "take-over p50, p99, s": shorts(quantile(away, 0.5), quantile(away, 0.99), before=more),
        "frames later than 1 s, per death": more + short(late),
        "deaths a day": short(plan.workers * 24 / plan.costs.failure.worker_mtbf_hours),
        "dollars per robot-hour, `trim` never, checkpoint": ", ".join(
            f"{cost_per_robot_hour(plan, kept):.2f}" for kept in disk
        ),
    }


def plan_table(plans: dict[str, list[Plan]], markdown: bool) -> str:
    columns = [column_of(name, plan) for name, some in plans.items() for plan in some]
    rows = [[name, *(column[name] for column in columns)] for name in columns[0]]
    text = table(rows, markdown)
    if "¹" in text:
        text += "\n\n¹ Does not do what is asked for, and more workers would not help."
    if "≥" in text:
        text += "\n\n≥: some take-overs had not ended when the simulation did."
    return text


def sweep_table(one: Sweep, markdown: bool) -> str:
    rows = [["robots", *next(iter(one.rows.values()))]]
    rows += [[f"{robots:,}", *map(percent, row.values())] for robots, row in one.rows.items()]
    end = f"Nothing is above {percent(one.limit)} up to {one.robots:,} robots."
    if one.first:
        end = f"First above {percent(one.limit)}: {one.first}, at about {one.robots:,} robots."
    return f"{table(rows, markdown)}\n\n{end}"
