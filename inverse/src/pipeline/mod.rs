//! From a frame to a picture and its touches.

mod contact_test;
mod following;
mod frame_solver;
mod image;
mod options;
mod polarity_test;
mod reconstructor;
mod result;
mod weighted;
mod work;

pub use options::ReconstructorOptions;
pub use reconstructor::Reconstructor;
pub use result::FrameResult;
pub use work::Work;
