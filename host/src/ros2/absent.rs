//! `--ros2` in a program that was built without it.

use super::Described;
use crate::event::Said;
use anyhow::{Result, bail};
use inverse::pipeline::FrameResult;
use inverse::reference::imager::Imager;
use inverse::touches::touch::Touch;
use link::MeasuredFrame;
use std::sync::Arc;
use view::picture::Picture;

/// There is none.
pub(crate) enum Ros2 {}

/// There is none.
pub(crate) enum Node {}

impl Ros2 {
    pub(crate) fn start(_namespace: Option<&str>) -> Result<Self> {
        bail!("--ros2: this program was built without ROS 2; build it with cargo build --release --features ros2")
    }

    pub(crate) fn node(&self, _of: &Described<'_>) -> Result<Node> {
        match *self {}
    }
}

impl Node {
    pub(crate) fn picture(
        &mut self,
        _unix_s: f64,
        _imager: &Arc<Imager>,
        _result: &FrameResult,
        _frame: &MeasuredFrame,
        _touches: Vec<Touch>,
    ) {
        match *self {}
    }

    pub(crate) fn shown(&self, _picture: &Arc<Picture>) {
        match *self {}
    }

    pub(crate) fn wants_baseline(&self) -> bool {
        match *self {}
    }

    pub(crate) fn event(&self, _said: &Said) {
        match *self {}
    }
}
