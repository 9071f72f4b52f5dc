"""Check each answer of the dashboard, for schemathesis; it imports this module by `SCHEMATHESIS_HOOKS`."""

import schemathesis

_INTERNAL_ERROR = 500  # 503 is an answer of its own: the cluster does not answer, or is asked too much


@schemathesis.check
def no_internal_error(
    context: schemathesis.CheckContext, response: schemathesis.Response, case: schemathesis.Case
) -> None:
    """Fail on an answer that tells of an exception in the server."""
    assert response.status_code != _INTERNAL_ERROR, response.text
