//! A front end: router, phase-sensitive detector and excitation together.

use crate::detect::Detect;
use crate::excitation::Excitation;
use crate::route::Router;

/// All that a scan needs. Implemented by whatever implements its parts; for the detector a [`Capture`](crate::Capture) will do.
pub trait FrontEnd: Router + Detect + Excitation {}

impl<T: Router + Detect + Excitation> FrontEnd for T {}
