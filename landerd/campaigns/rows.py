"""The rows of a campaign's table, of whatever kind."""

from collections.abc import Iterable
from typing import Any

from landerd.campaigns.failures import summary
from landerd.campaigns.fault_table import summary as fault_summary
from landerd.campaigns.plan import Campaign
from landerd.campaigns.pool import Run
from landerd.campaigns.poses import make_pose_row
from landerd.campaigns.table import make_row


def runs_of(campaign: Campaign, runs: Iterable[Run]) -> dict[str, list[Run]]:
    """Return the runs of each row of a campaign that has any, by name and in the seeds' order."""
    of: dict[str, list[Run]] = {row.name: [] for row in campaign.all_rows}
    for run in runs:
        if run.scenario in of:
            of[run.scenario].append(run)
    return {name: sorted(flown, key=lambda run: run.seed) for name, flown in of.items() if flown}


def make_rows(campaign: Campaign, runs: Iterable[Run]) -> list[dict[str, Any]]:
    """Return the figures of every row that was flown, in the campaign's order."""
    rows = []
    for name, flown in runs_of(campaign, runs).items():
        row = campaign.row(name)
        made = make_pose_row(row, flown) if row.poses else make_row(row, flown)
        if row.days:
            made["days"] = summary(flown)
        if row.faults:
            made["faults"] = found = fault_summary(flown)
            failed = made["failed_seeds"] = found["failed_seeds"]
            made["missed"] = [f"{len(failed)} flights failed"] if failed else []
        rows.append(made)
    return rows
