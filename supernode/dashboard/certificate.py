"""Check the files of the certificate and of its key, with which the dashboard speaks TLS."""

import ssl
from pathlib import Path

from problems.errors import BadInput
from supernode.files.private_file import read_private


def check_certificate(certificate: str, key: str) -> None:
    """Check that a server can use the two files, both in PEM.

    Raises:
        BadInput: if one of them cannot be read or is something else, the key is not that of the certificate or has a
            password, or others than its owner may read it.
    """
    expected = f"--dashboard-cert: {certificate}: expected a certificate in PEM"
    try:
        Path(certificate).read_bytes()
        ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_verify_locations(certificate)
    except OSError as error:  # an SSLError is one as well
        raise BadInput(f"{expected}, found {_words(error)}") from None
    read_private(Path(key), "--dashboard-key", "a private key in PEM")
    try:
        # The password is asked for by a function, so that nobody is asked at the terminal.
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password=lambda: "")
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            raise BadInput(f"--dashboard-key: {key}: expected the key of {certificate}, found another one's") from None
        expected = f"--dashboard-key: {key}: expected a private key in PEM without a password"
        raise BadInput(f"{expected}, found {_words(error)}") from None


def _words(error: OSError) -> str:
    if isinstance(error, ssl.SSLError):
        return (error.reason or "something else").replace("_", " ").lower()
    return error.strerror or str(error)
