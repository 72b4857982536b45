"""Who asks, and what they may do: roles and maps of an API key."""

from __future__ import annotations

from dataclasses import dataclass

from service.domain.errors import Forbidden, NotFound
from service.domain.lifecycle import Role


@dataclass(frozen=True)
class Actor:
    """Hold who asks: the key's id, its role, and the maps that it covers (None: all of them)."""

    key_id: str
    role: Role
    map_ids: frozenset[str] | None = None

    def covers(self, map_id: str) -> bool:
        """Return whether things of this map exist for the key at all."""
        return self.map_ids is None or map_id in self.map_ids

    def require_role(self, *roles: Role) -> None:
        """Pass when the key has one of `roles`.

        Raises
        ------
        Forbidden
            If it has another role.
        """
        if self.role not in roles:
            allowed = sorted(role.value for role in roles)
            raise Forbidden(
                f"This key has the role {self.role.value}; needed is {' or '.join(allowed)}.",
                required_roles=allowed,
            )

    def require_all_maps(self) -> None:
        """Pass when the key covers every map, those not yet made included.

        Raises
        ------
        Forbidden
            If the key is limited to some maps.
        """
        if self.map_ids is not None:
            raise Forbidden(
                "This key is limited to some maps; needed is a key that covers all of them.",
                required_roles=[self.role.value],
            )

    def require_map(self, map_id: str, *, otherwise: NotFound) -> None:
        """Pass when the key covers the map; what belongs to another map does not exist for the key.

        Raises
        ------
        NotFound
            `otherwise`, if the key does not cover the map.
        """
        if not self.covers(map_id):
            raise otherwise
