//! What can be believed of a frame: noise by reciprocity, faults of electrodes, contacts that changed, doubts.

pub mod contact;
pub mod diagnosis;
pub mod doubt;
pub mod faults;
pub mod reciprocity;
