"""A database that publishes an edit and dies before it says so."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.attempt import Attempt, Workshop
from service.domain import Unavailable
from service.openings import Openings, Room
from service.runner import Limits, Runner
from service.stores.blobs import Blobs
from service.stores.records import Records
from tests.service.core import job_of, new_edit
from tests.service.relay import Relay

pytest_plugins = ["tests.service.core_fixtures"]

LIMITS = Limits(30.0, 500 * 1024**2)


@pytest.fixture
def relay(migrated: str) -> Iterator[Relay]:
    with tempfile.TemporaryDirectory() as folder:  # a socket's path has to be short
        made = Relay(migrated, Path(folder))
        yield made
        made.close()


@pytest.fixture
def attempting(relay: Relay, blobs: Blobs, tmp_path: Path) -> Iterator[Workshop]:
    runner = Runner(("tests.service.fake_jobs",))
    records = Records(relay.url, patience=0.5)
    function, opener = "tests.service.fake_jobs:edit", "tests.service.fake_jobs:keep_edit_open"
    openings = Openings(
        runner, opener, LIMITS, Room(0, 0), folder=tmp_path / "open", scratch=tmp_path
    )
    yield Workshop(records, blobs, runner, openings, LIMITS, tmp_path, tmp_path, function)
    openings.close()
    runner.close()
    records.close()


@pytest.mark.parametrize("away", [False, True])
def test_results_stay_whose_publication_was_done_but_not_answered(
    records: Records, blobs: Blobs, relay: Relay, attempting: Workshop, away: bool
) -> None:
    edit_id = new_edit(records, {"text": "done"})
    attempt = Attempt(attempting, edit_id, job_of(records, edit_id))
    relay.lose_commit_of(b"INSERT INTO results", then_away=away)
    if away:
        with pytest.raises(Unavailable):
            attempt.run()
    else:
        attempt.run()
    assert relay.lost.is_set()
    assert records.get_edit(edit_id).status == "succeeded"
    (result,) = records.list_results(edit_id)
    assert blobs.get_range(result.blob_key, 0, result.bytes) == b"done []"
