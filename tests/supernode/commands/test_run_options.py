"""What the command line takes as settings of a run, files and Python take too."""

import argparse
import json

import pytest

from problems import Run, load
from supernode.commands import submit
from supernode.commands.run_options import add_run_options, settings, size


def parsed(*options):
    parser = argparse.ArgumentParser()
    add_run_options(parser)
    return parser.parse_args(["problem.toml", *options])


def test_the_command_line_names_every_setting_of_a_run():
    every = {name: "2" for name in Run.model_fields if name not in ("grow", "keep_alive", "oracle", "topology")}
    every |= {"mode": "async", "recipe": "paper", "replacement": "elitist", "spy": "root", "topology": "ring 4"}
    options = [text for name, value in every.items() for text in (f"--{name}", value)]
    assert settings(parsed(*options)).keys() == every.keys()
    assert settings(parsed("--no-oracle")) == {"oracle": False}
    parser = argparse.ArgumentParser()
    submit.add_arguments(parser)
    assert parser.parse_args(["problem.toml", "--keep-alive"]).keep_alive
    assert parser.parse_args(["problem.toml", "--grow"]).grow


@pytest.mark.parametrize(
    ("options", "setting"),
    [
        (["--torus", "2x3"], {"torus": "2x3"}),
        (["--topology", "ring 6"], {"topology": "ring 6"}),
        (["--mutation", "0.25"], {"mutation": 0.25}),
        (["--target", "-1"], {"target": -1}),
        (["--seconds", "0.5"], {"seconds": 0.5}),
        (["--restarts", "0"], {"restarts": 0}),
        (["--no-oracle"], {"oracle": False}),
    ],
)
def test_a_file_and_python_take_what_the_command_line_takes(file, options, setting):
    by_command = load(file).with_run(**settings(parsed(*options))).run
    assert load(file).with_run(**setting).run == by_command
    (name, value), text = next(iter(setting.items())), file.read_text()
    written = json.dumps(value)
    file.write_text(f"{text}\n[run]\n{name} = {written}\n")
    assert load(file).run == by_command


def test_a_wrong_torus_is_blamed_on_its_option(capsys):
    with pytest.raises(SystemExit):
        parsed("--torus", "4y4")
    assert "argument --torus: expected rows and columns such as \"4x4\", found '4y4'" in capsys.readouterr().err


def test_a_size_is_1m_at_least():
    assert [size(text) for text in ("500M", "2g", "1.5GB", "1048576")] == [500 << 20, 2 << 30, 3 << 29, 1 << 20]
    for text in ("512", "1000K", "0G", "-1M", "much"):
        with pytest.raises(argparse.ArgumentTypeError, match=f"500M or 2G, 1M at least, found {text}"):
            size(text)
