"""What keeps a scene from being rendered."""


class ExportError(Exception):
    """Nothing can be rendered; says why and what to do."""
