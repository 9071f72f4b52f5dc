"""What keeps a dashboard beside a cluster."""

from live_service import until

from supernode.dashboard import keeper as module
from supernode.dashboard.keeper import Keeper
from supernode.dashboard.listen_address import ListenAddress


def test_one_that_dies_at_its_start_is_started_again_later_and_later_and_it_is_said(monkeypatch, capfd):
    monkeypatch.setattr(module.sys, "executable", "/bin/false")
    monkeypatch.setattr(module, "_AGAIN", 0.01)
    said = []
    keeper = Keeper(ListenAddress("127.0.0.1", 0), single=False)
    try:
        keeper.start("tcp/127.0.0.1:1")
        until(lambda: said.append(capfd.readouterr().err) or "another starts in 0.04 s" in "".join(said))
    finally:
        keeper.close()
    first, second = "".join(said).splitlines()[:2]
    assert first == "warning: the dashboard died (exit status 1); another starts in 0.02 s"
    assert second == "warning: the dashboard died (exit status 1); another starts in 0.04 s"
