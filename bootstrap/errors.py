"""What can keep a set-up from going on."""


class SetupError(Exception):
    """The set-up cannot go on; the message is one line that says what is missing."""
