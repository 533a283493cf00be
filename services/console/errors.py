"""What a browser's wish may fail with; each becomes the sentence that its page shows."""

from common.errors import RetraverseError


class ConsoleError(RetraverseError):
    """The console cannot do what a page asks."""


class UnknownAction(ConsoleError):
    """A page asks for what the console does not know."""


class BadArguments(ConsoleError):
    """What a page sent is not what its action takes."""
