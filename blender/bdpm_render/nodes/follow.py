"""Links of node trees, through reroutes, muted nodes and groups."""

# Names of inputs that changed between versions of Blender.
RENAMED = {"Fac": "Factor", "Factor": "Fac"}


class Source:
    """An output of a node, with the groups that it is in, from the outermost on."""

    def __init__(self, node, output, groups):
        self.node, self.output, self.groups = node, output, groups

    def input(self, name):
        return Socket(self.node.inputs[name], self.groups)

    def has(self, name):
        return name in self.node.inputs and self.node.inputs[name].enabled

    def enabled(self, name):
        """The input of this name that counts: nodes such as Mix have several."""
        names = {name, RENAMED.get(name)}
        return next(Socket(i, self.groups) for i in self.node.inputs if i.name in names and i.enabled)


class Socket:
    """An input of a node, with the groups that it is in."""

    def __init__(self, socket, groups=()):
        self.socket, self.groups = socket, tuple(groups)

    def source(self):
        """What it is linked to, or None; and the socket whose value counts then."""
        socket, groups = self.socket, self.groups
        for _ in range(1000):
            link = (
                next((one for one in socket.links if not one.is_muted and one.is_valid), None)
                if socket.is_linked
                else None
            )
            if link is None:
                return None, socket
            node, output = link.from_node, link.from_socket
            while node.mute:
                inner = next((one for one in node.internal_links if one.to_socket == output), None)
                if inner is None:
                    return None, None
                socket, node, output = inner.from_socket, None, None
                break
            if node is None:
                continue
            if node.type == "REROUTE":
                socket = node.inputs[0]
            elif node.type == "GROUP_INPUT":
                if not groups:
                    return None, None
                group, groups = groups[-1], groups[:-1]
                socket = _same(group.inputs, output, node.outputs)
            elif node.type == "GROUP" and node.node_tree:
                end = next((n for n in node.node_tree.nodes if n.type == "GROUP_OUTPUT" and n.is_active_output), None)
                if end is None:
                    return None, None
                groups = groups + (node,)
                socket = _same(end.inputs, output, node.outputs)
            else:
                return Source(node, output, groups), socket
            if socket is None:
                return None, None
        return None, None


def _same(sockets, like, siblings):
    """The socket of another node that stands for this one."""
    found = next((s for s in sockets if s.identifier == like.identifier), None)
    return found or sockets[list(siblings).index(like)]


def output_of(tree, kinds):
    """The active output node of a tree, of these types, that Cycles would take; or None."""
    nodes = [n for n in tree.nodes if n.type in kinds and not n.mute and n.target in {"ALL", "CYCLES"}]
    nodes.sort(key=lambda n: (n.target == "CYCLES", n.is_active_output))
    return nodes[-1] if nodes else None
