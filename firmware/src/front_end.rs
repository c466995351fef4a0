//! A front end: router, capture and excitation together.

use crate::capture::Capture;
use crate::excitation::Excitation;
use crate::route::Router;

/// All that a scan needs. Implemented by whatever implements its parts.
pub trait FrontEnd: Router + Capture + Excitation {}

impl<T: Router + Capture + Excitation> FrontEnd for T {}
