"""What a potentiometer of 300 degrees means for the options."""

from math import radians

import pytest
from pydantic import ValidationError

from norton_drivers.feetech.options import FeetechOptions

SCS = {"node": 1, "type": "SCS0009", "mode": "position", "stall_torque": 0.2}


def test_goals_lie_where_it_tells_angles():
    options = FeetechOptions.model_validate(SCS)
    assert options.zero == 512
    assert options.greatest_position_rad == pytest.approx(radians(150.0), abs=radians(0.5))


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"mode": "pwm"}, 'SCS0009 tells less than a turn, and turns on beyond it: write mode = "position"'),
        ({"mode": "torque"}, 'write mode = "position"'),
        ({"zero": 2048}, "SCS0009 tells counts from 0 to 1023"),
    ],
)
def test_what_would_need_more_is_refused(wrong, sentence):
    with pytest.raises(ValidationError, match=sentence):
        FeetechOptions.model_validate({**SCS, **wrong})


def test_a_magnet_tells_all_of_a_turn():
    options = FeetechOptions.model_validate({**SCS, "type": "STS3215"})
    assert options.zero == 2048
    assert options.greatest_position_rad == pytest.approx(radians(180.0), abs=radians(0.2))
