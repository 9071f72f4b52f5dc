"""The certificate and its key, and what is said of wrong ones."""

import subprocess
from pathlib import Path

import pytest

from problems import BadInput
from supernode.dashboard.certificate import check_certificate


def refusal(certificate, key):
    with pytest.raises(BadInput) as refused:
        check_certificate(str(certificate), str(key))
    return str(refused.value)


def test_a_certificate_and_its_key_are_taken(certified):
    check_certificate(*certified())


def test_a_missing_file_is_named(certified, tmp_path):
    certificate, key = certified()
    missing = tmp_path / "missing.pem"
    expected = f"--dashboard-cert: {missing}: expected a certificate in PEM, found No such file or directory"
    assert refusal(missing, key) == expected
    assert refusal(certificate, missing).startswith(f"--dashboard-key: {missing}: expected a private key in PEM, found")


def test_each_in_the_other_s_place_is_refused(certified):
    certificate, key = certified()
    assert refusal(key, key).startswith(f"--dashboard-cert: {key}: expected a certificate in PEM, found no certificate")
    Path(certificate).chmod(0o600)
    assert refusal(certificate, certificate).startswith(
        f"--dashboard-key: {certificate}: expected a private key in PEM without a password, found"
    )


def test_another_s_key_is_refused(certified):
    (certificate, _), (_, key) = certified(), certified("other")
    assert (
        refusal(certificate, key) == f"--dashboard-key: {key}: expected the key of {certificate}, found another one's"
    )


def test_a_key_that_others_can_read_is_refused(certified):
    certificate, key = certified()
    Path(key).chmod(0o640)
    assert "only its owner can read, found mode 640" in refusal(certificate, key)


def test_a_key_with_a_password_is_refused_and_nobody_is_asked(certified):
    certificate, key = certified()
    subprocess.run(["openssl", "ec", "-in", key, "-out", key, "-aes128", "-passout", "pass:word"], check=True)
    assert refusal(certificate, key).startswith(
        f"--dashboard-key: {key}: expected a private key in PEM without a password"
    )
