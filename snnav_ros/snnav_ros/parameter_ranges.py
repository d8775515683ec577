"""Ranges of the parameters by the last part of their names, SI units: what a descriptor shows and a node refuses.

A time after which something counts as lost can be large, never zero: there is no "off" for it.
"""

from __future__ import annotations

__all__ = ["RANGES"]

_SHARE = (0.0, 1.0)
_DISTANCE = (0.0, 1000.0)
_LENGTH = (1e-3, 1000.0)
_DURATION = (1e-3, 3600.0)
_COUNT = (1, 1_000_000)

RANGES: dict[str, tuple[float, float]] = {
    # times [s]
    "sampling_interval": _DURATION,
    "control_period": (1e-3, 1.0),
    "scan_period": _DURATION,
    "max_scan_age": _DURATION,
    "max_area_age": _DURATION,
    "max_obstacles_age": _DURATION,
    "max_odometry_age": _DURATION,
    "command_timeout": (1e-3, 1.0),
    "pairing_patience": _DURATION,
    "clock_tolerance": (0.0, 10.0),
    "sharing_deadline": _DURATION,
    "joins_at": (0.0, 1e5),
    "leaves_at": (1e-3, 1e5),
    "window": _DURATION,
    "patience": _DURATION,
    # speeds [m/s], [rad/s]
    "boundary_speed": (0.0, 50.0),
    "speed": (1e-3, 50.0),
    "max_turn_rate": (1e-3, 50.0),
    "body_speed": (0.0, 50.0),
    "top_speed": (1e-3, 50.0),
    "least_speed": (1e-3, 50.0),
    "known_velocity": (1e-3, 50.0),
    "velocity_tolerance": (0.0, 50.0),
    # lengths [m]
    "safety_margin": _LENGTH,
    "radius": _LENGTH,
    "grid_resolution": (0.01, 10.0),
    "seen_resolution": (0.01, 10.0),
    "return_radius": _LENGTH,
    "path_spacing": _LENGTH,
    "arrival_distance": _LENGTH,
    "range_cut": _LENGTH,
    "saturation": _LENGTH,
    "robot_distance": _LENGTH,
    "link_distance": _LENGTH,
    "leg_distance": _LENGTH,
    "largest_body": _LENGTH,
    "free_depth": _LENGTH,
    "range_noise": (1e-6, 1000.0),
    "return_tolerance": _DISTANCE,
    "contradiction_depth": _DISTANCE,
    "robot_tolerance": _DISTANCE,
    "shorten_depth": _DISTANCE,
    "tracking_tolerance": _DISTANCE,
    "planning_reserve": _DISTANCE,
    "moving_reserve": _DISTANCE,
    "simplification": _DISTANCE,
    "range_accuracy": _DISTANCE,
    "jump_distance": _DISTANCE,
    # counts
    "time_window": (1, 1000),
    "search_interval": _COUNT,
    "searches_per_step": _COUNT,
    "followed_steps": (0, 1_000),
    "crowd": _COUNT,
    "max_adjusted": _COUNT,
    "expected_beams": (2, 1_000_000),
    "candidates": _COUNT,
    "lead": (0, 1_000),
    "retry": _COUNT,
    "doubted_steps": (0, 1_000),
    "least_samples": (2, 1_000),
    "least_points": _COUNT,
    "least_evidence": _COUNT,
    "cold_passes": _COUNT,
    "warm_passes": _COUNT,
    "seed": (0, 2**53),
    # others
    "heading_tolerance": (1e-3, 3.2),
    "pitch_deg": (-90.0, 90.0),
    "graze": _SHARE,
    "longest": (1.0, 100.0),
    "longest_link": (1.0, 100.0),
    "confidence": (1e-3, 1e3),
    "least_part": (0.0, 1000.0),
    "turn_radius_factor": (1.0, 100.0),
    "circle_radius_factor": (1.0, 100.0),
    "switch_gain": _SHARE,
    "jump_ratio": _DISTANCE,
    "rate": (1e-3, 1e3),
    "convergence_rate": (1e-3, 1e3),
    "boundary_layer": (1e-6, 1e3),
    "interval_gain": (1e-6, 1e3),
    "barrier_gain": (1e-6, 1e3),
    "pull": (1e-6, 1e3),
    "attenuation": _SHARE,
    "rest_threshold": (1e-9, 1e3),
    "shortest_end": (1e-6, 1e3),
    "longest_end": (1e-6, 1e3),
}
