"""Every failure that geoprior foresees: a sentence, a remedy and an exit code.

Exit codes are part of the command line's contract:

====  ==========================================================================
code  meaning
====  ==========================================================================
0     done
1     unforeseen: a defect of geoprior or of a plug-in
2     the command line or the config is wrong
3     a plug-in is missing, broken or in conflict
4     a file is damaged, foreign or not writable (shard, checkpoint, run folder)
5     the machine lacks something (GL, a library's version, memory, a worker died)
6     the numbers went wrong (a loss or an action that is not finite)
130   interrupted; run the same command again to go on
====  ==========================================================================
"""

from __future__ import annotations


class GeopriorError(Exception):
    """A foreseen failure.

    Args:
        message: What is wrong, naming the file, key, shard or tensor.
        hint: What the user can do about it, one sentence or one command.
    """

    exit_code = 1

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint

    def __reduce__(self) -> tuple[type[GeopriorError], tuple[str, str]]:
        """Survive the way back from a worker process with the hint intact."""
        return type(self), (self.message, self.hint)

    def __str__(self) -> str:
        return f"{self.message}\n  hint: {self.hint}" if self.hint else self.message


class ConfigError(GeopriorError):
    """A config, a key, a value or a name that the user wrote cannot be used."""

    exit_code = 2


class PluginError(GeopriorError):
    """A plug-in is missing, broken, or in conflict with another one."""

    exit_code = 3


class DataError(GeopriorError):
    """A shard, a checkpoint or a run folder is damaged, foreign or not writable."""

    exit_code = 4


class MachineError(GeopriorError):
    """The machine lacks something: GL, a library's version, memory, a living worker."""

    exit_code = 5


class NumericalError(GeopriorError):
    """A loss, a weight or an action that is not finite."""

    exit_code = 6
