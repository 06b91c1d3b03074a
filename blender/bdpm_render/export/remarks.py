"""What is approximated or ignored, by object, material or node."""


class Remarks:
    """Each remark once, in the order in which they came, with what they are about."""

    def __init__(self):
        self._found = {}

    def add(self, where, text):
        self._found.setdefault(text, {})[where] = None

    def lines(self):
        """One line each: `where: what`, with many places in short."""
        lines = []
        for text, places in self._found.items():
            places = list(places)
            shown = ", ".join(places[:3]) + (f" and {len(places) - 3} more" if len(places) > 3 else "")
            lines.append(f"{shown}: {text}")
        return lines
