//! The error type of this crate. Its messages name the expected and the found value.

/// A failure of an adapter, a device or an input.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// There is no adapter, or none has the requested name.
    #[error(
        "no vulkan adapter {wanted}found: have [{found}]; install a driver, or Mesa's llvmpipe to \
         run on the processor (Debian: mesa-vulkan-drivers)"
    )]
    NoAdapter {
        /// The requested name, quoted, or nothing.
        wanted: String,
        /// Names of the adapters that are there.
        found: String,
    },
    /// The driver of the adapter refuses to open a device.
    #[error("adapter {adapter} gives no device: {reason}")]
    NoDevice {
        /// Name of the adapter.
        adapter: String,
        /// Message of the driver.
        reason: String,
    },
    /// The adapter computes wrongly, or not at all.
    #[error(
        "adapter {adapter} fails the self-test: {reason}; update its driver or choose another \
         adapter"
    )]
    SelfTest {
        /// Name of the adapter.
        adapter: String,
        /// Which tier failed at what.
        reason: String,
    },
    /// The adapter cannot run a kernel of this size.
    #[error("adapter is too small: {limit} is {found}, needed {needed}")]
    Limit {
        /// Name of the limit.
        limit: &'static str,
        /// What the adapter offers.
        found: u64,
        /// What is needed.
        needed: u64,
    },
    /// The device was lost; every object made from it is dead.
    #[error("device lost: {0}")]
    DeviceLost(String),
    /// A buffer could not be allocated.
    #[error("out of device memory: buffer {label} of {bytes} bytes: {reason}")]
    OutOfMemory {
        /// Which buffer.
        label: String,
        /// Its size.
        bytes: u64,
        /// Message of the driver, or the limit that was exceeded.
        reason: String,
    },
    /// A shader or a pipeline was refused.
    #[error("kernel {kernel} does not compile: {reason}")]
    Kernel {
        /// Which kernel.
        kernel: &'static str,
        /// Message of the compiler.
        reason: String,
    },
    /// The device refused a command: a fault of this package.
    #[error("device refused a command: {0}")]
    Validation(String),
    /// Two sizes that must agree do not.
    #[error("{what}: expected {expected}, found {found}")]
    ShapeMismatch {
        /// Which field.
        what: &'static str,
        /// What it must be.
        expected: usize,
        /// What it is.
        found: usize,
    },
    /// A value is outside what the pass can use.
    #[error("{what}: expected {expected}, found {found}")]
    BadValue {
        /// Which field.
        what: &'static str,
        /// What it must be.
        expected: &'static str,
        /// What it is.
        found: String,
    },
}

/// `Ok` if the two sizes agree, a [`GpuError::ShapeMismatch`] that names them if not.
pub fn expect_len(what: &'static str, expected: usize, found: usize) -> Result<(), GpuError> {
    if expected == found { Ok(()) } else { Err(GpuError::ShapeMismatch { what, expected, found }) }
}
