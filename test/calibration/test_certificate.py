# SPDX-License-Identifier: Apache-2.0
"""A module's certificate: what it permits, and what is refused."""

import math
import re

import pytest
import yaml

from screw_module_ros.calibration.certificate import (
    LEAST,
    MOST,
    conditions_of,
    law_version,
    load_certificate,
    text_checksum,
)
from screw_module_ros.calibration.selection import CertificateSettings, chosen_certificate
from screw_module_ros.control import modes
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.settings import SettingError

SERIAL = "ARM-0007"


RATE = 1000.0
LAW = VerticalSettings(mass=5.437218, observer_inertia=0.35)
CONDITIONS = conditions_of(LAW, RATE, 1.26e-3, 30.0)


def written(
    folder, gains="{force_gain: 6.28, observer_gain: 12.6}", serial=SERIAL, conditions=CONDITIONS,
    law=None,
):
    text = (
        f"format: screw_module_ros/certificate\nversion: 1\nserial: {serial}\n"
        f"date: '2026-11-22T09:30:00Z'\nlaw: '{law or law_version()}'\npermitted_gains: {gains}\n"
    )
    text += yaml.safe_dump({"conditions": conditions._asdict()}) if conditions else ""
    file = folder / "module_certificate.yaml"
    file.write_text(f"{text}sha256: {text_checksum(text)}\n")
    return file


def test_no_file_limits_nothing():
    assert chosen_certificate(CertificateSettings(), "") is None


@pytest.mark.parametrize(
    ("mode", "field"), [(modes.FORCE_FEEDBACK, "force_gain"), (modes.COMBINED, "force_gain"),
                        (modes.OBSERVER, "observer_gain")]
)  # fmt: skip
def test_a_gain_beyond_it_is_refused_in_the_modes_that_use_it(tmp_path, mode, field):
    certificate = load_certificate(written(tmp_path), SERIAL)
    most = getattr(certificate.permitted_gains, field)
    at_most = LAW._replace(**{field: most})
    beyond = at_most._replace(**{field: most + 0.01})
    assert not certificate.refusal(at_most, mode, RATE)
    assert re.search(f"{field} is .*ARM-0007.* at most", certificate.refusal(beyond, mode, RATE))
    assert not certificate.refusal(beyond, modes.IMPEDANCE, RATE)


def departed(name, share):
    """Return law and rate with one condition of the certificate times a share."""
    if name == "rate":
        return LAW, RATE * share
    return LAW._replace(**{name: share * getattr(LAW, name)}), RATE


@pytest.mark.parametrize("mode", [modes.FORCE_FEEDBACK, modes.COMBINED, modes.OBSERVER])
@pytest.mark.parametrize("name", [*LEAST, *MOST])
def test_a_condition_that_costs_margin_is_refused_in_the_modes_it_matters_in(tmp_path, mode, name):
    """With 30 Hz in place of 9 the gain that is stable on a heavy arm falls from 16 to 5."""
    certificate = load_certificate(written(tmp_path), SERIAL)
    worse, better = (0.999, 1.001) if name in LEAST else (1.001, 0.999)
    for share in (1.0, better):
        law, rate = departed(name, share)
        assert not certificate.refusal(law, mode, rate)
    law, rate = departed(name, worse)
    told = certificate.refusal(law, mode, rate)
    gain = "observer_gain" if mode == modes.OBSERVER else "force_gain"
    if gain in {**LEAST, **MOST}[name]:
        limit = "at least" if name in LEAST else "at most"
        wanted = getattr(CONDITIONS, name)
        assert re.search(f"{name} is .*ARM-0007.* {wanted:.10g}.* {limit}.*uncertified", told)
    else:
        assert not told
    assert not certificate.refusal(law, modes.IMPEDANCE, rate)


def test_a_certificate_without_its_conditions_is_refused(tmp_path):
    with pytest.raises(SettingError, match="conditions is missing.*run stability"):
        load_certificate(written(tmp_path, conditions=None), SERIAL)
    with pytest.raises(SettingError, match="conditions.delay = nan: a finite number"):
        load_certificate(written(tmp_path, conditions=CONDITIONS._replace(delay=math.nan)), SERIAL)


def test_a_certificate_for_another_version_of_the_law_is_refused(tmp_path):
    with pytest.raises(SettingError, match="version 0123456789ab of the law.* run stability"):
        load_certificate(written(tmp_path, law="0123456789ab"), SERIAL)


@pytest.mark.parametrize(
    ("change", "serial", "told"),
    [
        (("force_gain: 6", "force_gain: 9"), SERIAL, "sha256: the file was changed"),
        (("version: 1", "version: 2"), SERIAL, "version"),
        (("sha256:", "sha257:"), SERIAL, "sha257 is unknown"),
        (("", ""), "ARM-0008", "module 'ARM-0007', this is module 'ARM-0008'.*name the file of th"),
        (("", ""), "", "set module_serial to the serial on the module"),
    ],
)
def test_another_modules_or_a_changed_one_is_refused(tmp_path, change, serial, told):
    file = written(tmp_path)
    file.write_text(file.read_text().replace(*change, 1))
    with pytest.raises(SettingError, match=told) as error:
        load_certificate(file, serial)
    assert str(file) in str(error.value)


@pytest.mark.parametrize(
    ("gains", "told"),
    [
        ("{force_gain: 6.28}", "permitted_gains.observer_gain is missing"),
        ("{force_gain: .inf, observer_gain: 9}", "permitted_gains.force_gain = inf"),
        ("{force_gain: -1, observer_gain: 9}", "force_gain = -1.0: below the smallest allowed, 0"),
        ("[6.28, 12.6]", "permitted_gains = .*: a mapping"),
    ],
)
def test_gains_that_are_none_are_refused(tmp_path, gains, told):
    with pytest.raises(SettingError, match=told):
        load_certificate(written(tmp_path, gains), SERIAL)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(SettingError, match="cannot be read"):
        load_certificate(tmp_path / "none.yaml", SERIAL)
