"""Text from files reaches the terminal without control characters: they could rename its window
or write to its clipboard.
"""

import json
from pathlib import Path

from tests.cli.typed import typed
from tests.recording.growing import grown

ESCAPES = "\x1b]0;owned\x07\x1b[2Jtitle\x9b31m\x08"


def test_texts_of_a_run_write_nothing_but_text(tmp_path: Path, monkeypatch, capsys):
    run = tmp_path / "runs" / "run"
    grown(run, 1).finish(ESCAPES)
    header = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(
        json.dumps(
            {
                **header,
                "title": ESCAPES,
                "provenance": {**header["provenance"], "operator": ESCAPES},
            }
        )
    )
    monkeypatch.chdir(tmp_path)
    for words in (
        ("runs",),
        ("check", run),
        ("recover", run),
        ("report", run, "--out", "report"),
        ("resume", run, "--dry-run"),
    ):
        said = typed(monkeypatch, capsys, *words)
        assert not set("\x1b\x07\x9b\x08") & set(said.out + said.err), words
