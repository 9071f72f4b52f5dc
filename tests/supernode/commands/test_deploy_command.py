import re
import shutil
import subprocess

import pytest
import yaml

from supernode.__main__ import main


def written(capsys, *arguments):
    assert main(["deploy", *arguments]) == 0
    text = capsys.readouterr().out
    assert "<<" not in text
    return text


def test_a_slurm_script_is_bash_with_the_size_asked_for(capsys, tmp_path):
    text = written(capsys, "slurm", "--hosts", "3", "--nodes", "8", "--time", "0:10:00")
    for line in ("#SBATCH --nodes=3", "#SBATCH --cpus-per-task=8", "#SBATCH --time=0:10:00", "--torus 4x6"):
        assert line in text
    (tmp_path / "cluster.sbatch").write_text(text)
    subprocess.run([shutil.which("bash"), "-n", tmp_path / "cluster.sbatch"], check=True)


def test_manifests_are_valid_and_fit_each_other(capsys):
    validate = pytest.importorskip("kubernetes_validate", reason="an extra")
    text = written(capsys, "kubernetes", "--hosts", "3", "--nodes", "8", "--image", "here/supernode:1")
    manifests = list(yaml.safe_load_all(text))
    for each in manifests:
        validate.validate(each, "1.28", strict=True)
    kinds = {(each["kind"], each["metadata"]["name"]): each["spec"] for each in manifests}
    agents = kinds["Job", "supernode-agents"]
    assert agents["completions"] == agents["parallelism"] == 3
    pods = [each["template"]["spec"] for each in kinds.values() if "template" in each]
    (coordinator,) = kinds["StatefulSet", "supernode-coordinator"]["template"]["spec"]["containers"]
    assert {"name": "SUPERNODE_NODES", "value": "24"} in coordinator["env"]
    assert all(container["image"] == "here/supernode:1" for pod in pods for container in pod["containers"])
    assert all(pod["securityContext"]["runAsNonRoot"] for pod in pods)
    assert kinds["Service", "supernode-router"]["selector"] == {"app": "supernode", "role": "router"}


def test_each_process_of_the_manifests_knows_its_settings(capsys):
    manifests = yaml.safe_load_all(written(capsys, "kubernetes"))
    pods = [each["spec"]["template"]["spec"] for each in manifests if "template" in each["spec"]]
    for container in (container for pod in pods for container in pod["containers"]):
        shell = container["command"][2] if "command" in container else ""
        command = container.get("args") or [re.search(r"/tmp/secret;\s+(?:exec )?supernode (\w+)", shell)[1]]
        with pytest.raises(SystemExit) as ended:
            main([command[0], "--help"])
        assert ended.value.code == 0
        help_text = capsys.readouterr().out
        assert all(f"[{each['name']}]" in help_text for each in container.get("env", ()))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["slurm", "--hosts", "0"], "--hosts: expected a whole number, at least 1, found 0"),
        (["slurm", "--image", "x"], "--image: expected it with kubernetes only, found it with slurm"),
        (["kubernetes", "--time", "1:00"], "--time: expected it with slurm only, found it with kubernetes"),
        (["slurm", "--nodes", "3000"], "--nodes: expected at most 2999 on a machine, 4 ports each, found 3000"),
        (["slurm", "--time", "soon"], "--time: expected one such as 1-12:00:00, found 'soon'"),
        (["kubernetes", "--image", "a: b"], "--image: expected one such as example.org/supernode:1, found 'a: b'"),
        (["slurm", "-o", "/nowhere/x"], "-o: expected a file that can be written"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments, said, capsys):
    assert main(["deploy", *arguments]) == 2
    assert said in capsys.readouterr().err
