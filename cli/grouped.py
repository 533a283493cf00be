"""One block of options for several commands: a dataclass whose fields are the options."""

import dataclasses
import functools
import inspect
from collections.abc import Callable
from typing import Any, get_type_hints


def grouped(kind: type[Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Gives a command, beside its own arguments, an option for each field of a dataclass.

    The command's first argument is the dataclass with the options' values.
    """
    hints = get_type_hints(kind, include_extras=True)
    fields = [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if field.default is dataclasses.MISSING else field.default,
            annotation=hints[field.name],
        )
        for field in dataclasses.fields(kind)
    ]

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        own = list(inspect.signature(command).parameters.values())[1:]

        @functools.wraps(command)
        def call(**values: Any) -> None:  # noqa: ANN401, whatever the options hold
            options = kind(**{field.name: values.pop(field.name) for field in fields})
            command(options, **values)

        parameters = [*own, *fields]
        call.__dict__["__signature__"] = inspect.Signature(parameters)
        call.__annotations__ = {one.name: one.annotation for one in parameters}
        del call.__dict__["__wrapped__"]
        return call

    return decorate
