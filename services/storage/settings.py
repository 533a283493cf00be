"""``[storage]``: the embedded object storage, as the server sees it too."""

from common.objects.embedded import EmbeddedSettings as Settings

__all__ = ["Settings"]
