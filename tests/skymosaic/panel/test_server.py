"""Where the panel listens."""

import pytest

from skymosaic.common.errors import InputError
from skymosaic.panel.server import _listen


def test_the_panel_listens_on_this_machine_only_and_refuses_a_taken_port() -> None:
    with _listen(0) as listener:
        host, port = listener.getsockname()
        assert host == "127.0.0.1"
        with pytest.raises(InputError, match=rf"port {port}: cannot be used \(Address already in use\); choose"):
            _listen(port)
