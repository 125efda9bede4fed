"""Proofs about closed loops: a network, a plant that is exact between commands, and a property of all times.

Sets of states are zonotopes. A network's answer to such a set is enclosed by linear functions of the state; the
plant moves the set on; sets that do not keep the property are split. `rans_proof.check` checks the resulting
certificate without any other module of this folder.
"""
