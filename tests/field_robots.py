"""Big robots of the field for the tests of statics: geometry as published, tension bounds assumed (none published)."""

import numpy as np
from robots import cable_robot

IPANEMA_ANCHORS = [
    [-8544, 5463, 3202], [8184, 5692, 3236], [8224, -5492, 3250], [-8491, -5322, 3221],
    [-8192, 5648, -589], [7208, 6463, -548], [7869, -5557, -527], [-8270, -5545, -582]]
IPANEMA_ATTACHMENTS = [
    [-70, 648, -260], [60, 648, -262], [60, -651, -262], [-70, -651, -260],
    [-85, 748, 261], [95, 749, 260], [95, -745, 260], [-85, -746, 261]]
COGIRO_ANCHORS = [
    [-7119.66, 5472.61, 5410.63], [7505.56, 5078.92, 5418.2], [7143.51, -5541.58, 5397.49],
    [-7478.55, -5154.4, 5400.93], [-7408.3, 5191.41, 5398.74], [7224.25, 5368.89, 5407.99],
    [7428.83, -5261.33, 5387.77], [-7196.73, -5439.78, 5392.77]]
COGIRO_ATTACHMENTS = [
    [496.05, 356.13, 999.61], [499.83, -340.38, 999.13], [-504.53, -346.32, 997.65], [-509.68, 350.8, 997.59],
    [-503.16, -269.97, 0], [-503.16, 492.82, 0], [502.14, 275.02, -0.67], [503.16, -492.82, 0]]


def _six_mm(low, high, level):
    return {"tension_min": np.full(8, low), "tension_max": np.full(8, high), "tension_reference": np.full(8, level),
            "axial_stiffness": np.full(8, 1e5 * np.pi / 4 * 6**2), "cable_radii": np.full(8, 3.0)}


def ipanema_3(**more):
    """IPAnema 3, Fraunhofer IPA: fully constrained, 17 x 12 x 4 m (geometry as in cdpyr)."""
    inertia = 1e6 * np.diag([5.226154, 0.637352, 4.723802])
    return cable_robot(IPANEMA_ANCHORS, IPANEMA_ATTACHMENTS, mass=30.0, inertia=inertia, name="ipanema-3",
                       **{**_six_mm(100.0, 3000.0, 800.0), **more})


def cogiro(**more):
    """CoGiRo, LIRMM and Tecnalia: suspended, 15 x 11 x 6 m, centre of mass off the platform origin (cdpyr, CASPR)."""
    about_origin = 1e6 * np.array([[42.955, -0.414, 2.205], [-0.414, 42.427, -1.849], [2.205, -1.849, 25.557]])
    centre = np.array([-34.0, -13.0, 264.0])
    inertia = about_origin - 91.058 * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return cable_robot(COGIRO_ANCHORS, COGIRO_ATTACHMENTS, mass=91.058, inertia=inertia, centre_of_mass=centre,
                       name="cogiro", **{**_six_mm(1.0, 5000.0, 400.0), **more})
