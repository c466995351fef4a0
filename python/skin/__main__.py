"""The program: ``python -m skin`` is ``skin``."""

from ._program import main

main()
