"""How long a test waits for what must come: long enough for a machine that has much else to do.

Nothing here measures speed: a test that succeeds does not wait, and absolute speed is measured in bench/.
"""

PATIENCE_S = 60.0
