"""When a configuration on trial has passed, and when it has failed."""

from lift_manager.hub.update.trial import FIRST_READINGS_S, OFFLINE_S, TRIAL_S, Judgement, Trial


def after(trial: Trial, seconds: float, *, offline: tuple[str, ...] = (), alarm: str = "") -> Trial:
    """Look once a second from the end of a trial so far."""
    for second in range(int(seconds) + 1):
        trial = trial.observed(BEGAN + second, offline, alarm)
    return trial


BEGAN = 1000.0
NEW = Trial(BEGAN)


def test_it_passes_once_everything_was_well_for_its_whole_time() -> None:
    assert after(NEW, TRIAL_S - 1).judgement is Judgement.OPEN
    assert after(NEW, TRIAL_S).judgement is Judgement.PASSED


def test_lifts_have_time_for_their_first_readings_and_then_must_be_read() -> None:
    assert after(NEW, FIRST_READINGS_S - 1, offline=("goods",)).judgement is Judgement.OPEN
    failed = after(NEW, FIRST_READINGS_S, offline=("goods",))
    assert (failed.judgement, failed.why) == (Judgement.FAILED, "goods could be read before, and cannot be read now")


def test_a_lift_that_is_lost_for_a_moment_does_no_harm_and_one_that_stays_away_fails_it() -> None:
    well = after(NEW, 100)
    lost = well.observed(BEGAN + 100, ("goods",), "").observed(BEGAN + 100 + OFFLINE_S - 1, ("goods",), "")
    assert lost.judgement is Judgement.OPEN
    back = lost.observed(BEGAN + 100 + OFFLINE_S, (), "")
    assert back.offline_since is None
    assert lost.observed(BEGAN + 100 + OFFLINE_S, ("goods",), "").judgement is Judgement.FAILED


def test_it_does_not_pass_while_a_lift_is_away() -> None:
    assert after(NEW, 100).observed(BEGAN + TRIAL_S, ("goods",), "").judgement is Judgement.OPEN


def test_an_alarm_fails_it_and_nothing_saves_it_afterwards() -> None:
    failed = NEW.observed(BEGAN + 1, (), "goods: fire")
    assert (failed.judgement, failed.why) == (Judgement.FAILED, "an alarm: goods: fire")
    assert after(failed, TRIAL_S + 1).judgement is Judgement.FAILED
