"""The authority's files, and the certificates in them."""

import stat
import threading
from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509

from problems.errors import BadInput
from supernode.files.authority import Authority, locked, own_names
from supernode.files.key_folder import identity_in, secret_in
from wire.members import CERTIFICATE, KEY, MEMBER, MEMBERS, OTHERS, ROUTERS, SECRET, Identity


@pytest.fixture
def authority(tmp_path):
    made = Authority.make(tmp_path / "keys")
    made.add("router", "router", (), 10.0, ("localhost", "10.0.0.1"))
    made.add("anna", "client", ("watch",), 10.0, ())
    return made


def certificate(authority, name):
    return x509.load_pem_x509_certificate((authority.folder / name / CERTIFICATE).read_bytes())


def test_a_certificate_names_its_member_and_its_addresses(authority):
    made = certificate(authority, "router")
    assert made.subject.rfc4514_string() == "CN=router"
    names = made.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert [str(each.value) for each in names] == ["localhost", "10.0.0.1"]
    left = made.not_valid_after_utc - datetime.now(UTC)
    assert timedelta(days=9.9) < left <= timedelta(days=10)
    made.verify_directly_issued_by(x509.load_pem_x509_certificate((authority.folder / ROUTERS).read_bytes()))


def test_no_other_member_can_pose_as_a_router(authority):
    authority.add("h2", "node", (), 1.0, ("10.0.0.1",))
    routers = x509.load_pem_x509_certificate((authority.folder / ROUTERS).read_bytes())
    for name in ("anna", "h2"):
        with pytest.raises(ValueError, match="Issuer"):
            certificate(authority, name).verify_directly_issued_by(routers)
        certificate(authority, name).verify_directly_issued_by(
            x509.load_pem_x509_certificate((authority.folder / OTHERS).read_bytes())
        )


def test_only_the_owner_can_read_any_file(authority):
    paths = [authority.folder, *authority.folder.rglob("*")]
    assert len(paths) > 10
    assert {stat.S_IMODE(path.stat().st_mode) & 0o077 for path in paths} == {0}


def test_the_list_of_members_is_with_the_router_alone(authority):
    assert [each.name for each in Identity.read(authority.folder / "router").members()] == ["router", "anna"]
    assert not (authority.folder / "anna" / MEMBERS).exists()


def test_the_secret_is_for_those_who_command(authority):
    for role in ("coordinator", "spy", "node"):
        authority.add(role, role, (), 1.0, ())
    secrets = {secret_in(identity_in(authority.folder, role)) for role in ("coordinator", "spy", "node")}
    assert len(secrets) == 1
    assert not (authority.folder / "anna" / SECRET).exists()
    assert not (authority.folder / "router" / SECRET).exists()
    (authority.folder / "spy" / SECRET).unlink()
    with pytest.raises(BadInput, match=r"--keys: .*secret: expected the cluster's secret"):
        secret_in(identity_in(authority.folder, "spy"))
    (authority.folder / "spy" / SECRET).write_text("x")
    (authority.folder / "spy" / SECRET).chmod(0o600)
    with pytest.raises(BadInput, match=r"--keys: .*secret: expected the secret that `supernode keys` made"):
        secret_in(identity_in(authority.folder, "spy"))


def test_renewed_keys_last_as_long_as_those_before(authority):
    before, key = certificate(authority, "anna"), (authority.folder / "anna" / KEY).read_bytes()
    authority.renew("anna", None)
    after = certificate(authority, "anna")
    assert after.serial_number != before.serial_number
    assert (authority.folder / "anna" / KEY).read_bytes() != key
    ten_days = timedelta(days=10)
    assert abs(after.not_valid_after_utc - datetime.now(UTC) - ten_days) < timedelta(minutes=1)


def test_a_revoked_member_is_off_the_list_and_its_keys_are_gone(authority):
    authority.revoke("anna")
    assert [each.name for each in Identity.read(authority.folder / "router").members()] == ["router"]
    assert not (authority.folder / "anna").exists()
    assert list(Authority(authority.folder).members) == ["router"]
    for known in (authority, Authority(authority.folder)):
        with pytest.raises(BadInput, match="expected a new name, found one that was revoked"):
            known.add("anna", "client", (), 1.0, ())


def test_the_only_router_stays(authority):
    with pytest.raises(BadInput, match="router: expected another router to be left, found none"):
        authority.revoke("router")


def test_a_member_whose_folder_was_moved_is_renewed_and_revoked(authority, tmp_path):
    (authority.folder / "anna").rename(tmp_path / "elsewhere")
    assert authority.renew("anna", None).days == 10.0
    (authority.folder / "anna").rename(tmp_path / "again")
    authority.revoke("anna")
    assert "anna" not in authority.members


def test_one_process_at_a_time_changes_an_authority(authority):
    def change(number):
        with locked(authority.folder):
            Authority(authority.folder).add(f"m{number}", "client", (), 1.0, ())

    threads = [threading.Thread(target=change, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(Authority(authority.folder).members) == 10


@pytest.mark.parametrize("address", ["", "tls/1.2.3.4:7", "ümlaut.example", "a b"])
def test_addresses_that_no_host_has(authority, address):
    with pytest.raises(BadInput, match="--address: expected a host's name or address"):
        authority.add("h2", "node", (), 1.0, (address,))


@pytest.mark.parametrize("days", [1e9, 0.0, float("nan")])
def test_times_that_no_certificate_can_last(authority, days):
    with pytest.raises(BadInput, match="--days: expected at most 36500"):
        authority.add("h2", "node", (), days, ())


@pytest.mark.parametrize("name", ["anna", "a/b", "", "anyone", "a.b", "secret"])
def test_names_that_no_member_can_have(authority, name):
    with pytest.raises(BadInput, match="expected"):
        authority.add(name, "client", (), 1.0, ())


def test_a_folder_with_files_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(BadInput, match="expected an empty folder or none, found files in it"):
        Authority.make(tmp_path)


def test_a_folder_without_an_authority(tmp_path):
    with pytest.raises(BadInput, match=r"No such file or directory; `supernode keys init .*` makes an authority"):
        Authority(tmp_path)
    for name in (ROUTERS, OTHERS, "routers.key", "members.key"):
        (tmp_path / name).write_text("x")
    with pytest.raises(BadInput, match="expected an authority of `supernode keys init`"):
        Authority(tmp_path)


def test_an_identity_is_found_in_both_kinds_of_folder(authority):
    assert identity_in(authority.folder, "router") == identity_in(authority.folder / "router", "router")


def test_folders_that_are_no_identity(authority, tmp_path):
    expected = "--keys: .*anna: expected the key folder of a spy, found that of a client"
    with pytest.raises(BadInput, match=expected):
        identity_in(authority.folder / "anna", "spy")
    with pytest.raises(BadInput, match=r"--keys: .*: expected the key folder of a spy, which `supernode keys` makes"):
        identity_in(tmp_path / "nowhere", "spy")
    (authority.folder / "anna" / KEY).chmod(0o644)
    with pytest.raises(BadInput, match=r"expected a file that only its owner can read; chmod 600 .*member\.key"):
        identity_in(authority.folder / "anna", "client")
    (authority.folder / "anna" / MEMBER).write_text("{}")
    with pytest.raises(BadInput, match=r"--keys: .*member\.json: expected name, role"):
        identity_in(authority.folder / "anna", "client")


def test_this_machine_has_names():
    assert "127.0.0.1" in own_names()
    assert "localhost" in own_names()
