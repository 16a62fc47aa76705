"""The command line ``unspoken`` of a device: this robot, and nothing of the bench."""

from chassis.commands import lazy_app
from protocol.version import version_text

app = lazy_app(
    "One mobile robot that crosses others' paths without communicating. 'unspoken agent' is that robot; "
    "the world and the bench come with the whole of Unspoken.",
    {"agent": ("agent.__main__:main", "Run one robot, or check whether this device is ready to.")},
    version_text,
)
