"""The directory of a campaign: what is kept, what is refused, what is repeated."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from snnav_core.errors import InvalidInput
from snnav_sim.campaign.ledger import Campaign, open_ledger
from snnav_sim.campaign.run import failed_run, run_seed

CAMPAIGN = Campaign("static", 4, 7)


def some_run(number: int) -> dict[str, object]:
    return failed_run("static", run_seed(7, number), None, f"error {number}", "")


def begin(directory: Path, runs: int = 2) -> None:
    with open_ledger(CAMPAIGN, directory) as ledger:
        for number in range(runs):
            ledger.add(some_run(number))


def refused(message: str, campaign: Campaign, directory: Path) -> None:
    with pytest.raises(InvalidInput, match=message), open_ledger(campaign, directory):
        pass


def test_what_was_added_is_there_again(tmp_path: Path) -> None:
    begin(tmp_path / "campaign")
    with open_ledger(CAMPAIGN, tmp_path / "campaign") as ledger:
        assert ledger.records == [some_run(0), some_run(1)]
        assert ledger.missing == [7_000_002, 7_000_003]
    with open_ledger(Campaign("static", 1, 7), tmp_path / "campaign") as ledger:
        assert ledger.records == [some_run(0)]
        assert ledger.missing == []


def test_a_line_that_was_not_finished_is_repeated(tmp_path: Path) -> None:
    begin(tmp_path)
    path = tmp_path / "runs.jsonl"
    whole = path.read_bytes()
    for cut in (1, 20, len(whole) // 2 - 1):
        path.write_bytes(whole[:-cut])
        with open_ledger(CAMPAIGN, tmp_path) as ledger:
            assert ledger.records == [some_run(0)]
            ledger.add(some_run(1))
        assert path.read_bytes() == whole


@pytest.mark.parametrize(
    "line", ["nonsense", "[]", "17", '{"kind": "multi", "seed": 1}', '{"kind": "static"}', ""]
)
def test_a_broken_line_in_the_middle_is_named(tmp_path: Path, line: str) -> None:
    begin(tmp_path)
    path = tmp_path / "runs.jsonl"
    first, second = path.read_text().splitlines()
    path.write_text(f"{first}\n{line}\n{second}\n")
    with (
        pytest.raises(InvalidInput, match=r"runs\.jsonl:2: is no run of this campaign: delete the line"),
        open_ledger(CAMPAIGN, tmp_path),
    ):
        pass


def test_another_campaign_is_refused(tmp_path: Path) -> None:
    begin(tmp_path)
    for other in (Campaign("multi", 4, 7), Campaign("static", 4, 8)):
        with (
            pytest.raises(InvalidInput, match="holds a campaign of --kind static --seed 7: ask for that"),
            open_ledger(other, tmp_path),
        ):
            pass


@pytest.mark.parametrize("key", ["versions", "sources"])
def test_another_program_is_refused(tmp_path: Path, key: str) -> None:
    begin(tmp_path)
    header = json.loads((tmp_path / "campaign.json").read_text())
    (tmp_path / "campaign.json").write_text(json.dumps(header | {key: "others"}))
    with (
        pytest.raises(InvalidInput, match=f"was begun by another program \\({key} differ\\): give another"),
        open_ledger(CAMPAIGN, tmp_path),
    ):
        pass


@pytest.mark.parametrize("content", ["", "{", "[]", "{}"])
def test_a_damaged_header_is_told(tmp_path: Path, content: str) -> None:
    begin(tmp_path)
    (tmp_path / "campaign.json").write_text(content)
    with (
        pytest.raises(InvalidInput, match=r"campaign\.json: is damaged: give another directory"),
        open_ledger(CAMPAIGN, tmp_path),
    ):
        pass


def test_other_directories_and_files_are_refused_and_stay_as_they_are(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with (
        pytest.raises(InvalidInput, match=r"holds files of something else than a campaign \(notes.txt\)"),
        open_ledger(CAMPAIGN, tmp_path),
    ):
        pass
    with (
        pytest.raises(InvalidInput, match="is a file: give another directory"),
        open_ledger(CAMPAIGN, tmp_path / "notes.txt"),
    ):
        pass
    with (
        pytest.raises(InvalidInput, match="cannot be written"),
        open_ledger(CAMPAIGN, tmp_path / "notes.txt" / "sub"),
    ):
        pass
    assert [entry.name for entry in tmp_path.iterdir()] == ["notes.txt"]


def test_two_campaigns_do_not_write_to_one_directory(tmp_path: Path) -> None:
    with (
        open_ledger(CAMPAIGN, tmp_path),
        pytest.raises(InvalidInput, match="a campaign is going on there"),
        open_ledger(CAMPAIGN, tmp_path),
    ):
        pass
    begin(tmp_path)
