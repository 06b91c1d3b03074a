//! The photons that count at a point, beyond the test of single photons: how far, and of which
//! surfaces.

/// Maximum number of times that the radii at a point are halved.
pub const MAX_LEVEL: u8 = 5;

/// The photons that may count at a point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Domain(u8);

/// The bit of [`Domain::is_own_layer`].
const OWN_LAYER: u8 = 1 << 7;

impl Domain {
    /// Photons of all surfaces within `2^-level` of the merge radii.
    pub fn at_level(level: u8) -> Self {
        debug_assert!(level <= MAX_LEVEL);
        Self(level)
    }

    /// Only photons that arrived on the side of the connected surface on which the point is.
    #[must_use]
    pub fn of_own_layer(self) -> Self {
        Self(self.0 | OWN_LAYER)
    }

    /// The number of times that the merge radii are halved.
    #[inline(always)] // part of vectorized code, as the functions below
    pub fn level(self) -> u8 {
        self.0 & !OWN_LAYER
    }

    /// Whether only photons on the point's own side of its connected surface count.
    #[inline(always)]
    pub fn is_own_layer(self) -> bool {
        self.0 & OWN_LAYER != 0
    }

    /// Whether photons of all surfaces count, within the merge radii.
    #[inline(always)]
    pub fn is_whole(self) -> bool {
        self == Self::default()
    }
}
