//! The profiles of a world's NPCs. A profile without NPCs may be replaced.

use super::World;
use crate::character::CharacterProfile;
use crate::npc::{MAX_PROFILES, ProfileIdx};
use crate::recording::Input;

impl World {
    /// Index of a profile. A profile that the world lacks replaces a profile without NPCs, except the first one, or is
    /// added. `None` if the world would then have more than `limit` profiles, at most 256.
    pub fn profile_idx(&mut self, profile: &CharacterProfile, limit: usize) -> Option<ProfileIdx> {
        if let Some(known) = self.config.profiles.iter().position(|known| known == profile) {
            return Some(ProfileIdx(known as u8));
        }
        let in_use = self.profiles_in_use();
        let free = (0..limit.min(MAX_PROFILES)).find(|idx| !in_use[*idx])?;
        let idx = ProfileIdx(free as u8);
        if free < self.config.profiles.len() {
            self.note(Input::Reprofile(idx, Box::new(profile.clone())));
            self.config.profiles[free] = profile.clone();
        } else {
            self.config.profiles.push(profile.clone());
            if let Some(recording) = &mut self.recording {
                recording.profiles.push(profile.clone());
            }
        }
        Some(idx)
    }

    /// Repeats the change of a profile that no NPC has; false, and nothing changes, if that cannot have been.
    pub(crate) fn reprofile(&mut self, idx: ProfileIdx, profile: CharacterProfile) -> bool {
        let idx = usize::from(idx.0);
        let is_free = idx < self.config.profiles.len() && !self.profiles_in_use()[idx];
        if is_free {
            self.config.profiles[idx] = profile;
        }
        is_free
    }

    /// Whether each profile is the first one or that of an NPC.
    fn profiles_in_use(&self) -> [bool; MAX_PROFILES] {
        let mut in_use = [false; MAX_PROFILES];
        in_use[0] = true;
        self.npcs.iter().flatten().for_each(|npc| in_use[usize::from(npc.profile.0)] = true);
        in_use
    }
}
