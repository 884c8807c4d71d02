# SPDX-License-Identifier: Apache-2.0
"""Quality of service and message class of a recorded topic."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from screw_module_ros.recording import (
    BagError,
    Qos,
)

from .support.topics import message_class

LOG = "/rosout"
_DEPTH = 2000  # messages in a queue: two seconds of a 1 kHz topic


def recorded_class(type_name: str) -> type:
    """Return the message class of a topic. Raises BagError when its package is not installed."""
    try:
        return message_class(type_name)
    except (ImportError, AttributeError) as error:
        raise BagError(f"its type {type_name} is not installed here: {error}") from None


def satisfying(topic: str, offers: list[TopicEndpointInfo]) -> QoSProfile:
    """Return the strictest request that every offer satisfies (as rosbag2 does).

    Of `LOG` only new lines are requested: those of the last seconds name the last bag, and so its
    patient.
    """
    profiles = [offer.qos_profile for offer in offers]
    reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
    kept = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
    latched = kept and topic != LOG
    return QoSProfile(
        depth=_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def is_stricter(have: QoSProfile, wanted: QoSProfile) -> bool:
    """Return whether `have` requests more than `wanted`."""
    return (
        have.reliability == ReliabilityPolicy.RELIABLE != wanted.reliability
        or have.durability == DurabilityPolicy.TRANSIENT_LOCAL != wanted.durability
    )


def offered_by(offer: TopicEndpointInfo) -> Qos:
    """Return a publisher's quality of service in rosbag2's format."""
    profile = offer.qos_profile
    return Qos(
        reliability=profile.reliability.name.lower(),
        durability=profile.durability.name.lower(),
        history=profile.history.name.lower(),
        depth=profile.depth,
        deadline=divmod(profile.deadline.nanoseconds, 1_000_000_000),
        lifespan=divmod(profile.lifespan.nanoseconds, 1_000_000_000),
        liveliness=profile.liveliness.name.lower(),
        lease=divmod(profile.liveliness_lease_duration.nanoseconds, 1_000_000_000),
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
    )
