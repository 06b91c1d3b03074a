//! What is kept beside one image from two of other iterations.

use super::{FeatureBuffers, Parts};

impl FeatureBuffers {
    /// Adds what other iterations have seen; `false` where their parts differ.
    pub(crate) fn merge(&mut self, other: &Self) -> bool {
        if self.parts != other.parts {
            return false;
        }
        for (own, new) in self.guides.iter_mut().zip(&other.guides) {
            own.albedo += new.albedo;
            own.normal += new.normal;
        }
        self.places.iter_mut().zip(&other.places).for_each(|(own, new)| own.add(new, 1.0));
        self.iterations.iter_mut().zip(&other.iterations).for_each(|(n, m)| *n += m);
        true
    }
}

impl Parts {
    /// Adds those of other iterations.
    pub(crate) fn merge(&mut self, other: &Self) {
        self.sums.iter_mut().zip(&other.sums).for_each(|(own, new)| *own += *new);
        self.iterations.iter_mut().zip(other.iterations).for_each(|(n, m)| *n += m);
    }
}
