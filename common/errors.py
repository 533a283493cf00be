"""The errors a user can meet.

```
RetraverseError
├── ConfigurationError     the robot's TOML file, or a calibration, is wrong
├── BusError
│   ├── NoRouter           nothing answers at the router's address
│   ├── NoAnswer           nobody served the query in time
│   ├── Refused            somebody served it, and said no
│   ├── Unavailable        somebody served it, and cannot do it now: the same may succeed later
│   └── MalformedMessage   bytes that are no message of their topic
├── ImageError             an image, or two of them, from which nothing can be computed
└── GraphError             a vertex, edge or map that does not exist, or contradicts another
```

Each message is one sentence that says what is wrong and what to do. The command line prints it and exits with 1.
"""


class RetraverseError(Exception):
    """Base of every error that is meant to be read by a person."""


class ConfigurationError(RetraverseError):
    """A configuration or calibration that cannot be used."""


class BusError(RetraverseError):
    """Base of what can go wrong between two processes."""


class NoRouter(BusError):
    """No Zenoh router answers at the configured address."""


class NoAnswer(BusError):
    """Nobody answered a query before its time-out."""


class Refused(BusError):
    """A query was answered with a refusal; the text is the answerer's reason."""


class Unavailable(BusError):
    """What was asked cannot be done now (a full disk, say); nothing was changed, and asking again later may succeed.

    A handler raises it as any other error that is meant to be read; the asker gets it as itself.
    """


class MalformedMessage(BusError):
    """Bytes that cannot be decoded into the message of their topic."""


class ImageError(RetraverseError):
    """An image, or a pair of images, from which nothing can be computed."""


class GraphError(RetraverseError):
    """The pose graph has no such part, or the new part contradicts a stored one."""
