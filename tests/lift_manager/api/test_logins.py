"""Logins, without a browser or a socket."""

import pytest

from lift_manager.api.keys import Key, KeyRing, Keys, Secret
from lift_manager.api.logins import LOGIN_S, LOGINS_PER_KEY, READER_LOGIN_S, Logins
from lift_manager.api.roles import Role

DESK = Key("00000001", "desk", Role.OPERATOR)
WALL = Key("00000002", "wall", Role.VIEWER)


class Clock:
    now = 1000.0

    def __call__(self) -> float:
        return self.now


class Site:
    """Logins of keys that come and go, by a clock that the test sets."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.live = {DESK, WALL}
        self.logins = Logins(self.keys(), self.clock)

    def keys(self) -> Keys:
        site = self

        class Live(KeyRing):
            def admits(self, key: Key | None) -> bool:
                return key in site.live

        return Live()


def test_a_login_stands_for_its_key_until_it_is_ended() -> None:
    logins = Site().logins
    (token, login), (other, _) = logins.begin(DESK), logins.begin(WALL)
    assert logins.find(token) is login
    assert login.key == DESK
    logins.end(login)
    logins.end(login)
    assert logins.find(token) is None
    assert not logins.is_live(login)
    assert logins.find(other) is not None


@pytest.mark.parametrize(("key", "lasts_s"), [(DESK, LOGIN_S), (WALL, READER_LOGIN_S)])
def test_a_login_ends_with_its_time_and_use_does_not_prolong_it(key: Key, lasts_s: float) -> None:
    site = Site()
    token, login = site.logins.begin(key)
    for share in (0.5, 0.999):
        site.clock.now = 1000.0 + share * lasts_s
        assert site.logins.find(token) is login
        assert site.logins.remaining_s(login) == pytest.approx((1 - share) * lasts_s)
    site.clock.now = 1000.0 + lasts_s
    assert site.logins.find(token) is None


def test_a_login_ends_with_its_key_and_stays_over_if_the_key_has_changed_meanwhile() -> None:
    site = Site()
    token, _ = site.logins.begin(DESK)
    site.live = {Key(DESK.id, DESK.name, Role.ROBOT, ("east",)), WALL}
    assert site.logins.find(token) is None
    site.logins.begin(WALL)
    site.live = {DESK, WALL}
    assert site.logins.find(token) is None


def test_a_key_with_too_many_logins_loses_its_oldest_one_and_none_of_another_key() -> None:
    logins = Site().logins
    wall, _ = logins.begin(WALL)
    tokens = [logins.begin(DESK)[0] for _ in range(LOGINS_PER_KEY + 1)]
    assert [logins.find(token) is None for token in tokens] == [True] + [False] * LOGINS_PER_KEY
    assert logins.find(wall) is not None


def test_tokens_cannot_be_guessed_from_each_other_and_none_is_kept() -> None:
    logins = Site().logins
    begun = [logins.begin(DESK) for _ in range(10)]
    texts = {token.reveal() for token, _ in begun} | {login.csrf for _, login in begun}
    assert len(texts) == 20
    assert min(map(len, texts)) >= 43  # 256 bits
    assert not any(token.reveal() in str(vars(logins)) for token, _ in begun)
    assert logins.find(Secret("")) is None
