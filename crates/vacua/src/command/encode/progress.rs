//! How far encoding is, on a terminal.

use std::io::IsTerminal as _;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use vacua_pack::{EncodeProgress, EncodeStage};

/// A bar that says what is being done; nothing unless standard error is a terminal.
pub struct Progress(Option<ProgressBar>);

impl Progress {
    /// A bar at the start.
    pub fn new() -> Self {
        if !std::io::stderr().is_terminal() {
            return Self(None);
        }
        let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr());
        let template = "{msg:28} {wide_bar} {percent:>3} % {elapsed}";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        Self(Some(bar))
    }

    /// Shows how far it is.
    pub fn show(&self, progress: EncodeProgress) {
        let Some(bar) = &self.0 else {
            return;
        };
        let message = match progress.stage {
            EncodeStage::Partition => "splitting into sub-meshes",
            EncodeStage::Submeshes => "encoding sub-meshes",
            EncodeStage::Outer => "building the outer tree",
            EncodeStage::Write => "writing",
        };
        if bar.message() != message {
            bar.set_message(message);
        }
        bar.set_length(progress.total);
        bar.set_position(progress.done);
    }

    /// Takes the bar away.
    pub fn finish(self) {
        if let Some(bar) = self.0 {
            bar.finish_and_clear();
        }
    }
}
