"""What commands say while they go on, and at the end of it."""

from mi_dogsplat.cli.progress import Bar
from mi_dogsplat.cli.training_run import shown_training
from mi_dogsplat.training.events import NotPruned, ShDegree


def test_what_an_earlier_start_has_done_tells_nothing_of_the_speed(capsys):
    with Bar("step") as bar:
        bar.show(1000, 2000)
    assert capsys.readouterr().err.splitlines()[-1].endswith("1000/2000 [00:00<?, ?step/s]")


def test_a_bar_that_is_closed_says_no_more(capsys):
    with Bar("step") as bar:
        bar.show(1, 2)
        bar.close()
        said = capsys.readouterr().err
    assert said and not capsys.readouterr().err


def test_a_training_that_had_nothing_to_prune_says_so_at_its_end(capsys):
    rows = [{"step": 1, "n": 7, "events": [event.record for event in (ShDegree(1), NotPruned("too small"))]}]
    with shown_training(2) as show:
        for row in (*rows, {"step": 2, "n": 7, "l1": 0.1}, {"step": 2, "n": 7, "measured": 3}):
            show(row)
    lines = ["no pruning: too small", "all steps are done; measuring 3 test views and writing the report"]
    assert capsys.readouterr().out.splitlines()[-2:] == lines
