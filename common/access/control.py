"""Rights as Zenoh's ``access_control``: rules, subjects, and policies that join them; what is not allowed is denied.

There are no rules that deny: a sample may be sent to a key expression, as ``vtr/**``, which a rule about
``vtr/*/command/safe`` does not cover.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from common.access import rights
from common.access.names import Role
from common.access.rights import Right


@dataclass(frozen=True, slots=True)
class Subject:
    """Whom rights are given: all links that have each of the features which are named.

    Attributes:
        name: unique in an ``access_control``.
        rights: what they may do.
        common_names: of certificates.
        users: who has proved to know a password.
        protocols: of links, as ``tls``.
    """

    name: str
    rights: list[Right]
    common_names: tuple[str, ...] = ()
    users: tuple[str, ...] = ()
    protocols: tuple[str, ...] = field(default=())

    def features(self) -> dict[str, list[str]]:
        """As Zenoh names them; a feature that is not asked for is left out."""
        named = {"cert_common_names": self.common_names, "usernames": self.users, "link_protocols": self.protocols}
        return {key: list(values) for key, values in named.items() if values}


def access_control(subjects: Sequence[Subject]) -> dict[str, Any]:
    """Zenoh's ``access_control`` that gives each subject its rights, and nobody else any.

    Raises:
        ValueError: a subject without any feature, which would be everybody.
    """
    for subject in subjects:
        if not subject.features():
            raise ValueError(f"the rights of '{subject.name}' would be everybody's")
    rules = {s.name: [_rule(s.name, n, right) for n, right in enumerate(s.rights) if right.keys] for s in subjects}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for some in rules.values() for rule in some],
        "subjects": [{"id": s.name, **s.features()} for s in subjects],
        "policies": [{"rules": [rule["id"] for rule in some], "subjects": [name]} for name, some in rules.items()],
    }


def at_robot(robot: str, local: str, uplink: str | None, *, passwords: bool) -> list[Subject]:
    """Who comes to a robot's router: its own processes, over ``local``, and the fleet's router, over ``uplink``.

    Both are protocols of links. Without passwords the processes are not told apart, and each may do what any may.
    """
    own = {process: rights.of_process(robot, process) for process in rights.processes()}
    if passwords:
        subjects = [Subject(f"process {name}", own[name], users=(name,), protocols=(local,)) for name in own]
    else:
        subjects = [Subject("processes", [right for some in own.values() for right in some], protocols=(local,))]
    if uplink is not None:
        subjects.append(Subject("fleet", rights.of_uplink(robot), protocols=(uplink,)))
    return subjects


def at_server(local: str, remote: str, valid: Mapping[Role, Mapping[str, Sequence[str]]]) -> list[Subject]:
    """Who comes to the fleet's router: the server's processes, and whose certificates are valid, over ``remote``."""
    subjects = [Subject("server", rights.of_server(), protocols=(local,))]
    given = [(f"robot {name}", rights.of_robot(name), names) for name, names in valid.get(Role.ROBOT, {}).items()]
    for role, granted in ((Role.OPERATOR, rights.of_operator()), (Role.VIEWER, rights.of_viewer())):
        given += [(f"{role} {name}", granted, names) for name, names in valid.get(role, {}).items()]
    subjects += [Subject(s, granted, tuple(names), protocols=(remote,)) for s, granted, names in given if names]
    return subjects


def _rule(subject: str, number: int, right: Right) -> dict[str, Any]:
    return {
        "id": f"{subject}: {number}",
        "permission": "allow",
        "flows": [right.flow.value],
        "messages": list(right.kind.value),
        "key_exprs": list(dict.fromkeys(right.keys)),
    }
