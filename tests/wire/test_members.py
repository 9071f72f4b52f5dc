"""Members, as files describe them."""

import json

import pytest

from wire.members import MEMBER, MEMBERS, BadMemberError, Identity, Member, is_name, member_of_host

ANNA = Member("anna", "client", ("watch", "submit"), "2027-01-01T00:00:00+00:00", ("localhost",), 30.0)


def test_a_member_survives_its_file():
    assert Member.of(json.loads(json.dumps(ANNA.to_json()))) == ANNA


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"name": "anna/x"}, "name: expected letters, digits, '_' and '-', found 'anna/x'"),
        ({"name": "anyone"}, "name: expected letters"),
        ({"name": "a.b"}, "name: expected letters"),
        ({"name": 3}, "name: expected letters"),
        ({"role": "boss"}, "role: expected one of coordinator, router, spy, node, client, dashboard, found 'boss'"),
        ({"may": ["fly"]}, "may: expected some of watch, submit, change, down, found"),
        ({"may": 3}, "expected name, role, may, expires, addresses and days"),
        ({"other": 3}, "expected name, role, may, expires, addresses and days"),
        ({"expires": 7}, "expires: expected a date, found 7"),
        ({"expires": "soon"}, "expires: expected a date, found 'soon'"),
        ({"days": "many"}, "expected a number of days, and addresses as text"),
        ({"addresses": [3]}, "expected a number of days, and addresses as text"),
    ],
)
def test_what_no_member_can_be(change, expected):
    with pytest.raises(BadMemberError, match=expected):
        Member.of(ANNA.to_json() | change)


@pytest.mark.parametrize("fields", [None, [], "x", {}])
def test_what_describes_no_member(fields):
    with pytest.raises(BadMemberError, match="expected name, role"):
        Member.of(fields)


def test_names():
    assert is_name("node-h2")
    assert not is_name("-h2")
    assert not is_name("a" * 64)
    assert not is_name("h2.$*")


def test_a_host_id_tells_its_member(tmp_path):
    assert member_of_host(Identity(Member("node-h2", "node"), tmp_path).host_id("ab12")) == "node-h2"
    assert member_of_host("ab12") == ""


def test_the_files_of_a_folder(tmp_path):
    (tmp_path / MEMBER).write_text(json.dumps(ANNA.to_json()))
    identity = Identity.read(tmp_path)
    assert identity.member == ANNA
    before = identity.stamp()
    (tmp_path / MEMBERS).write_text(json.dumps([ANNA.to_json()]))
    assert identity.members() == (ANNA,)
    assert identity.stamp() != before
    (tmp_path / MEMBERS).write_text("[")
    with pytest.raises(BadMemberError, match="expected JSON"):
        identity.members()
    (tmp_path / MEMBERS).write_text("{}")
    with pytest.raises(BadMemberError, match="expected a list of members"):
        identity.members()
