"""Files in: one small module a format, one registry, and `read` above them. Out: `write_orientation`, `write_angles`."""

from imufast.io.align import align
from imufast.io.angle_files import write_angles
from imufast.io.orientation_files import write_orientation
from imufast.io.reading import read
from imufast.io.registry import format_names

__all__ = ["align", "format_names", "read", "write_angles", "write_orientation"]
