"""Errors and warnings; each message says what to do."""


class LexsplatError(Exception):
    """Any error of this package."""


class CameraError(LexsplatError, ValueError):
    """A camera's description is wrong."""


class FrameError(LexsplatError, ValueError):
    """A frame has a wrong type, shape or value. Nothing of it was sent."""


class AddressError(LexsplatError, ValueError):
    """An address, a token or a certificate cannot be used."""


class NoServerError(LexsplatError, ConnectionError):
    """Nothing that can be talked to is at the address."""


class BrokenError(LexsplatError, ConnectionError):
    """The connection broke and did not come back in time, or the map was not loaded in time.

    Acknowledged frames are in the map. The same program, run again, goes on after them.
    """


class AccessError(LexsplatError, PermissionError):
    """The token is missing or wrong, or does not permit this."""


class NotFoundError(LexsplatError, LookupError):
    """There is no such map, or the map has not tracked this frame."""


class BusyError(LexsplatError):
    """Somebody else streams into the map, or the map exists already."""


class RequestError(LexsplatError, ValueError):
    """The server refused the request. The message names the field."""


class ServerError(LexsplatError):
    """The server cannot do it: a limit is reached, a map failed, a disk is full."""


class InputWarning(UserWarning):
    """Something is probably wrong with the frames: the unit of depth, inverted poses, axes."""


class ForgottenWarning(UserWarning):
    """The server came back without frames that it had acknowledged: it keeps no data directory."""
