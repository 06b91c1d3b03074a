"""Receives the image while it renders: bdpm sends it as to the viewer tev, over TCP on this machine.

The protocol, little-endian: each packet begins with its length and its kind; strings end in a zero byte.
"""

import socket
import struct
import threading

import numpy as np

CREATE, UPDATE = 4, 6
LARGEST = 1 << 33


class Receiver:
    """Listens on a free port, in a thread of its own, and keeps the last image."""

    def __init__(self):
        self._socket = socket.socket()
        self._socket.bind(("127.0.0.1", 0))
        self._socket.listen(1)
        self._lock = threading.Lock()
        self._channels = None
        self.address = "127.0.0.1:%d" % self._socket.getsockname()[1]
        threading.Thread(target=self._listen, daemon=True).start()

    def take(self):
        """Channels by name, float32 of shape (height, width), if new ones have come; else None."""
        with self._lock:
            channels, self._channels = self._channels, None
        return channels

    def close(self):
        """Stops listening."""
        try:
            self._socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass  # nobody was connected
        self._socket.close()

    def _listen(self):
        # Anything unexpected ends the connection: the image comes at the end all the same.
        try:
            connection, _ = self._socket.accept()
            with connection:
                while True:
                    length = struct.unpack("<I", _exactly(connection, 4))[0]
                    if not 5 <= length < LARGEST:
                        return
                    packet = _exactly(connection, length - 4)
                    if packet[0] == UPDATE:
                        channels = _update(packet)
                        with self._lock:
                            self._channels = channels
        except (OSError, EOFError, struct.error, ValueError):
            return


def _exactly(connection, count):
    buffer = bytearray(count)
    view = memoryview(buffer)
    while view:
        got = connection.recv_into(view)
        if not got:
            raise EOFError
        view = view[got:]
    return buffer


def _update(packet):
    at = 2  # kind, and whether to grab the focus
    at = packet.index(0, at) + 1  # the image's name
    count = struct.unpack_from("<i", packet, at)[0]
    at += 4
    names = []
    for _ in range(count):
        end = packet.index(0, at)
        names.append(packet[at:end].decode())
        at = end + 1
    _, _, width, height = struct.unpack_from("<4i", packet, at)
    at += 16
    offsets = struct.unpack_from(f"<{count}q", packet, at)
    at += 16 * count  # offsets and strides, which are 1
    data = np.frombuffer(packet, "<f4", (len(packet) - at) // 4, at)
    pixels = width * height
    return {name: data[offset : offset + pixels].reshape(height, width) for name, offset in zip(names, offsets)}
