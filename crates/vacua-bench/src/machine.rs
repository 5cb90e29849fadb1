//! What the figures were measured on: machine, date and commit.

use std::process::Command;
use std::time::SystemTime;

use serde::{Deserialize, Serialize};
use sysinfo::{CpuRefreshKind, MemoryRefreshKind, RefreshKind, System};
use vacua_simd::Level;

/// A machine, and when and with which code it was used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Model of the processor.
    pub cpu: String,
    /// Cores that this process may use.
    pub cores: usize,
    /// Threads that the benchmark used.
    pub threads: usize,
    /// Instruction set that kernels ran on.
    pub simd: String,
    /// Operating system and architecture.
    pub system: String,
    /// Bytes of memory.
    pub memory_bytes: u64,
    /// Bytes of memory that were free at the start; 0 if unknown.
    pub available_bytes: u64,
    /// When the benchmark began, UTC, RFC 3339.
    pub date: String,
    /// Commit of the working folder, `+` behind it if files differ; absent outside a checkout or
    /// without git.
    pub commit: Option<String>,
    /// Whether this is a release build.
    pub optimized: bool,
}

impl Machine {
    /// Describes this machine.
    pub fn describe(threads: usize) -> Self {
        let wanted = RefreshKind::nothing()
            .with_cpu(CpuRefreshKind::nothing())
            .with_memory(MemoryRefreshKind::nothing().with_ram());
        let system = System::new_with_specifics(wanted);
        let cpu = system.cpus().first().map(|cpu| cpu.brand().trim());
        Self {
            cpu: cpu
                .filter(|c| !c.is_empty())
                .unwrap_or("unknown")
                .to_owned(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            threads,
            simd: match Level::best() {
                Level::Baseline => "baseline",
                Level::Avx2 => "AVX2",
                Level::Avx512 => "AVX-512",
            }
            .to_owned(),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            memory_bytes: system.total_memory(),
            available_bytes: system.available_memory(),
            date: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            commit: commit(),
            optimized: !cfg!(debug_assertions),
        }
    }

    /// A list for people.
    pub fn markdown(&self) -> String {
        const GIB: f64 = (1u64 << 30) as f64;
        let build = if self.optimized {
            "release build"
        } else {
            "debug build, figures mean little"
        };
        format!(
            "{}, {} cores, {} threads, {}, {:.1} GiB, {}; {}; commit {}; {build}.\n",
            self.cpu,
            self.cores,
            self.threads,
            self.simd,
            self.memory_bytes as f64 / GIB,
            self.system,
            self.date,
            self.commit.as_deref().unwrap_or("unknown"),
        )
    }
}

/// Bytes of memory that are free now; 0 if unknown.
pub(crate) fn available_bytes() -> u64 {
    let wanted = RefreshKind::nothing().with_memory(MemoryRefreshKind::nothing().with_ram());
    System::new_with_specifics(wanted).available_memory()
}

/// The commit of the working folder.
fn commit() -> Option<String> {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        output.status.success().then(|| text.trim().to_owned())
    };
    let hash = git(&["rev-parse", "--short=12", "HEAD"])?;
    let changed = git(&["status", "--porcelain", "--untracked-files=no"])?;
    let mark = if changed.is_empty() { "" } else { "+" };
    Some(format!("{hash}{mark}"))
}
