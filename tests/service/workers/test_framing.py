import random
import socket
import threading

import pytest

from service.workers import main


def test_any_cut_of_the_stream_gives_the_same_payloads() -> None:
    random_source = random.Random(1)
    payloads = [random_source.randbytes(random_source.choice((0, 1, 7, 300))) for _ in range(200)]
    stream = b"".join(main.encode(payload) for payload in payloads)
    decoder = main.FrameDecoder()
    received: list[bytes] = []
    position = 0
    while position < len(stream):
        step = random_source.choice((1, 3, 8, 500))
        received += decoder.feed(stream[position : position + step])
        position += step
    assert received == payloads


def test_garbage_is_refused() -> None:
    with pytest.raises(ValueError, match="a frame of"):
        list(main.FrameDecoder().feed(b"\xff" * 8))


def test_large_payload_over_a_socket_and_the_end_of_it() -> None:
    ours, theirs = socket.socketpair()
    payload = random.Random(2).randbytes(3_000_000)

    def send() -> None:
        with theirs:
            theirs.sendall(main.encode(payload))

    sender = threading.Thread(target=send)
    sender.start()
    with ours:
        assert main.receive(ours) == payload
        with pytest.raises(EOFError):
            main.receive(ours)
    sender.join()
