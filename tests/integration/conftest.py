import pytest

pytest.register_assert_rewrite("running_system")
