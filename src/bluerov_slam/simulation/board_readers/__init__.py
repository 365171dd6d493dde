"""The firmware's readers of the small sensors once more, as the reference that checks the C++ ones bit for bit.

The rules are `docs/firmware-core.md` section 6. Names and order of operations are those of `firmware/lib/brov_core`.
"""
