"""What machines ask a dashboard, and what it says when the cluster is away."""

from live_service import until


def test_health_follows_the_cluster(shown, service):
    assert until(lambda: shown.ask("GET", "/healthz")[0] == 200)
    service.stop()
    text = until(lambda: (told := shown.ask("GET", "/healthz"))[0] == 503 and told[2])
    assert text.count("\n") == 1
    service.start()
    assert until(lambda: shown.ask("GET", "/healthz")[0] == 200)


def test_metrics_are_of_the_cluster(shown, service):
    text = until(lambda: (found := shown.ask("GET", "/metrics")[2]) and "supernode_up 1.0" in found and found)
    assert "supernode_nodes_alive 0.0" in text
    assert "# TYPE supernode_evaluations_total counter" in text
    assert "python_info" not in text


def test_a_form_hands_in_a_job(shown, service):
    form = "file=kind+%3D+%22function%22%0Aname+%3D+%22onemax%22%0Adimension+%3D+8&id=mine&seconds=1.5&seed="
    headers = {"Content_Type": "application/x-www-form-urlencoded"}
    status, _, text = until(lambda: (told := shown.ask("POST", "/api/jobs", form, **headers))[0] != 503 and told)
    assert (status, text) == (201, '{"job":"mine"}')
    assert list(service.jobs) == ["mine"]


def test_each_kind_has_a_page_to_start_from(shown):
    status, _, text = shown.ask("GET", "/api/templates/arm-ik")
    assert (status, 'kind = "arm-ik"' in text) == (200, True)
    assert shown.ask("GET", "/api/templates/nothing")[0] == 400
