//! The merged light of camera paths.

use super::super::kernel::ByClass;
use super::super::pair_list::PairList;
use super::{MergeOptions, Workspace};
use crate::base::math::Rgb;
use std::ops;

/// The merged light of camera paths; buffers are reused for the next ones.
#[derive(Debug, Default)]
pub struct MergeOutput {
    /// `sum_i I_ij` of each camera path, W/(m^2 sr).
    pub sums: Vec<Rgb>,
    /// The terms of these sums, from [`Merge::gather_pairs`](super::Merge::gather_pairs).
    pub pairs: PairList,
    /// Part of the sums from caustic photons at first vertices, if recorded.
    pub caustics: Vec<Rgb>,
    /// The sums less the sums at half the merge radii, by photon class, if recorded.
    pub annulus: Vec<ByClass<Rgb>>,
    pub(super) workspace: Workspace,
}

impl MergeOutput {
    /// Sets the sums of as many camera paths to 0.
    pub(super) fn clear(&mut self, paths: usize, options: &MergeOptions) {
        let Self { sums, caustics, annulus, .. } = self;
        sums.resize(paths, Rgb::ZERO);
        caustics.resize(if options.records_caustics { paths } else { 0 }, Rgb::ZERO);
        annulus.resize(if options.records_annulus { paths } else { 0 }, [Rgb::ZERO; 2]);
        self.clear_part(&(0..paths));
    }

    /// Sets the sums of some camera paths to 0.
    pub(super) fn clear_part(&mut self, part: &ops::Range<usize>) {
        self.sums[part.clone()].fill(Rgb::ZERO);
        if !self.caustics.is_empty() {
            self.caustics[part.clone()].fill(Rgb::ZERO);
        }
        if !self.annulus.is_empty() {
            self.annulus[part.clone()].fill([Rgb::ZERO; 2]);
        }
    }
}
