"""The exception by which a message ends what a device is doing."""


class Interrupted(BaseException):
    """A step of a device is ended from outside, as by Ctrl-C: no error, so that no driver takes it for one."""
