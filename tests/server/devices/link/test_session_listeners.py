"""Listeners of a session."""

import numpy as np

from imuscope.protocols.events import Batch, Event, Reply
from imuscope.protocols.schema.fields import Message
from imuscope.server.devices.link.session_listeners import SessionListeners
from imuscope.server.links.base import Flow


def samples(device: str = "") -> Batch:
    return Batch(Message(0x36, "MTData2"), device, np.array([1]), np.array([0]), None, {})


def reply(device: str = "") -> Reply:
    return Reply(Message(0x31, "GoToConfigAck"), {}, 0, 5, 1, device)


def test_news_of_a_device_are_its_replies_and_the_first_samples_after_each() -> None:
    """Every batch of a live device went through the code that configures it."""
    listeners, news = SessionListeners(Flow()), list[Event]()
    off = listeners.listen_to_news(news.append)
    first, second, answer, again = samples(), samples(), reply(), samples()
    listeners.publish([first, second, samples("of another"), answer, again, samples()], own="")
    listeners.publish([samples(), reply("of another"), samples()], own="")
    assert news == [first, answer, again]
    listeners.expect_samples()
    expected = samples()
    listeners.publish([expected, samples()], own="")
    assert news[3:] == [expected]
    off()
    late = list[Event]()
    listeners.listen_to_news(late.append)
    listeners.publish([first, second], own="")
    assert late == [first], "a device of the line is configured after its first samples"
    listeners.publish([reply()], own="")
    assert len(news) == 4
