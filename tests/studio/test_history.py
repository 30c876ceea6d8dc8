from plat.studio.history import History


def test_steps_are_undone_one_by_one_and_redone():
    history = History(0)
    for state in (1, 2, 3):
        history.do(state)
    history.undo()
    history.undo()
    assert history.state == 1
    history.redo()
    assert history.state == 2
    assert history.can_undo
    assert history.can_redo


def test_undo_and_redo_stop_at_the_ends():
    history = History(0)
    history.undo()
    history.redo()
    assert history.state == 0
    assert not history.can_undo
    assert not history.can_redo


def test_what_was_undone_is_lost_with_a_new_step():
    history = History(0)
    history.do(1)
    history.undo()
    history.do(2)
    history.redo()
    assert history.state == 2


def test_a_gesture_is_undone_as_one():
    history = History(0)
    history.do(1)
    for state in (2, 3, 4):
        history.do(state, gesture="slider")
    history.undo()
    assert history.state == 1
    history.redo()
    assert history.state == 4


def test_another_gesture_or_the_end_of_one_begins_a_step():
    history = History(0)
    history.do(1, gesture="a")
    history.do(2, gesture="b")
    history.end_gesture()
    history.do(3, gesture="b")
    history.undo()
    assert history.state == 2
    history.undo()
    assert history.state == 1


def test_an_undo_ends_the_gesture():
    history = History(0)
    history.do(1, gesture="a")
    history.undo()
    history.do(2, gesture="a")
    history.undo()
    assert history.state == 0


def test_the_oldest_steps_are_forgotten():
    history = History(0, limit=2)
    for state in (1, 2, 3):
        history.do(state)
    for _ in range(3):
        history.undo()
    assert history.state == 1
