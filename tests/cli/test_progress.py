"""What the bars of commands say of the speed."""

from mi_dogsplat.cli.progress import Bar


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
