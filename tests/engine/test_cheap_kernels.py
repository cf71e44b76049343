"""The kernels of this suite compute what those of users do."""

import cheap_kernels
import numpy as np
import pytest
from packet_process import in_process, picture_and_gradients


@pytest.mark.usefixtures("all_cores")
@pytest.mark.skipif(not cheap_kernels.CHEAP, reason="kernels are compiled as for users; needs Linux and a C compiler")
def test_llvms_passes_change_no_bit_of_pictures_and_gradients(tmp_path):
    found, expected = in_process(cheap_kernels.environment_of_users(), tmp_path), picture_and_gradients()
    assert found["same_bits"]
    for name, values in expected.items():
        assert np.abs(values).max() > 0
        np.testing.assert_array_equal(found[name], values, err_msg=name)
