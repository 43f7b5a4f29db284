"""Records of hours of work: found where they match, and never overwritten by another configuration's."""

import numpy as np

from p2l.ledger import Item, find, write
from p2l.metareskill.ledger import Entry, Ledger
from p2l.skills.relative import SIZE


def test_a_record_of_another_configuration_stays_and_both_are_found(tmp_path, caplog):
    one, other = (Item("door", "rc", 0, 0, name) for name in ("one", "other"))
    write(tmp_path, one, {"value": 1}, seconds=1.0)
    write(tmp_path, other, {"value": 2}, seconds=1.0)
    write(tmp_path, other, {"value": 3}, seconds=1.0)
    assert find(tmp_path, one) == {"value": 1}
    assert find(tmp_path, other) == {"value": 3}
    assert sorted(file.name for file in tmp_path.iterdir()) == ["door-rc-s0-b0-other.json", "door-rc-s0-b0.json"]
    (tmp_path / one.file).write_text("{}")
    assert find(tmp_path, one) is None
    assert "made anew" in caplog.text
    write(tmp_path, one, {"value": 4}, seconds=1.0)
    assert find(tmp_path, one) == {"value": 4}


def entry(q):
    return Entry(0, True, np.zeros(SIZE), np.array([0.5]), np.zeros(0), 7, q, 10, 0.1)


def test_queries_of_another_training_stay_and_both_go_on(tmp_path):
    """Another processor's last bits once made another identity, and the committed queries were overwritten."""
    path = tmp_path / "door-ledger-s0.npz"
    for identity, q in (("here", 0.1), ("there", 0.2), ("there", 0.3), ("here", 0.4)):
        ledger = Ledger.open(path, identity)
        ledger.add((0, 0, len(ledger.entries)), entry(q))
    for identity, expected in (("here", [0.1, 0.4]), ("there", [0.2, 0.3])):
        assert [each.q for each in Ledger.open(path, identity).entries.values()] == expected
    assert sorted(file.name for file in tmp_path.iterdir()) == ["door-ledger-s0-there.npz", "door-ledger-s0.npz"]
    damaged = path.read_bytes()
    path.write_bytes(damaged[: len(damaged) // 2])
    anew = Ledger.open(path, "here")
    assert not anew.entries
    anew.add((0, 0, 0), entry(0.5))
    assert path.read_bytes() == damaged[: len(damaged) // 2]
