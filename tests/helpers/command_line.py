"""The command ``dogsplat``, called in this process."""

from mi_dogsplat.cli import main


def run(capsys, *argv) -> tuple[int, str, str]:
    """(exit status, stdout, stderr)"""
    try:
        status = main([str(argument) for argument in argv])
    except SystemExit as stop:  # argparse: --help and wrong use
        status = stop.code
    captured = capsys.readouterr()
    return int(status or 0), captured.out, captured.err


def assert_one_line(result: tuple[int, str, str], *words: str) -> None:
    status, out, err = result
    assert status == 2 and out == "", result
    assert err.count("\n") == 1 and err.startswith("dogsplat: ") and "Traceback" not in err, err
    for word in words:
        assert word in err
