"""The errors that users meet: what was expected, what was found, what to do."""


class PointmorphError(Exception):
    """Base of all errors that the package raises deliberately.

    Attributes
    ----------
    subject : str
        The object, feature, option or file in question.
    expected, found, advice : str
        What was expected, what was found, and what to do about it.
    """

    def __init__(self, subject: str, expected: str, found: str, advice: str) -> None:
        super().__init__(f"{subject}: expected {expected}, found {found}. {advice}")
        self.subject = subject
        self.expected = expected
        self.found = found
        self.advice = advice

    def __reduce__(self) -> tuple[type, tuple[str, str, str, str]]:
        return type(self), (self.subject, self.expected, self.found, self.advice)


class CloudError(PointmorphError):
    """Points, normals, colors or radii that can't be used."""


class FeatureError(PointmorphError):
    """A feature or a loop that doesn't fit the clouds."""


class OptionError(PointmorphError):
    """An option out of range, or options that contradict each other."""


class TopologyError(PointmorphError):
    """Shapes whose topology the chosen method can't handle."""


class ConvergenceError(PointmorphError):
    """A computation that didn't reach the requested accuracy."""


class FileError(PointmorphError):
    """A file that can't be read or written."""


class Cancelled(Exception):  # noqa: N818  (like KeyboardInterrupt, it is no error)
    """Raised when the caller's progress function returned False."""
