//! Graphs as assets, for apps that have Bevy's asset server: feature `asset`.
//!
//! ```no_run
//! # use bevy_asset::AssetServer; use bevy_ecs::prelude::*; use bevy_surefoot::{SurefootAgent, assets::PlansBy};
//! fn spawn(mut commands: Commands<'_, '_>, server: Res<'_, AssetServer>) {
//!     commands.spawn((SurefootAgent::default(), PlansBy(server.load("level.graph.json"))));
//! }
//! ```

use crate::error::SurefootError;
use crate::graph::SurefootGraph;
use crate::{SurefootAgent, SurefootSystems};
use bevy_app::{App, FixedUpdate, Plugin};
use bevy_asset::io::Reader;
use bevy_asset::{AssetApp, AssetLoader, Assets, Handle, LoadContext};
use bevy_ecs::prelude::*;
use bevy_reflect::TypePath;
use serde::{Deserialize, Serialize};

/// Lets the asset server load graphs from `.graph.json`. Needs Bevy's `AssetPlugin` before it.
#[derive(Debug, Clone, Copy, Default)]
pub struct SurefootAssetPlugin;

/// The graph on which an agent plans. Once it is loaded, the agent has it as the component [`SurefootGraph`]. An agent
/// whose goal is inserted before that heads straight for it, without a plan.
#[derive(Component, Debug, Clone)]
pub struct PlansBy(pub Handle<SurefootGraph>);

/// How a graph is loaded.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct GraphSettings {
    /// Where the level's origin lies on its map, m: [`SurefootGraph::with_origin`].
    pub origin: [f32; 3],
}

/// Loads [`SurefootGraph`].
#[derive(Debug, Clone, Copy, Default, TypePath)]
pub struct GraphLoader;

impl Plugin for SurefootAssetPlugin {
    fn build(&self, app: &mut App) {
        app.init_asset::<SurefootGraph>()
            .register_asset_loader(GraphLoader)
            .add_systems(FixedUpdate, attach.before(SurefootSystems::Aim));
    }
}

impl AssetLoader for GraphLoader {
    type Asset = SurefootGraph;
    type Settings = GraphSettings;
    type Error = SurefootError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        settings: &GraphSettings,
        context: &mut LoadContext<'_>,
    ) -> Result<SurefootGraph, SurefootError> {
        let mut bytes = Vec::new();
        let path = context.path().path().to_owned();
        reader.read_to_end(&mut bytes).await.map_err(|source| SurefootError::Io { path, source })?;
        let text = String::from_utf8(bytes).map_err(|_| SurefootError::Graph("it is not text".to_owned()))?;
        Ok(SurefootGraph::from_json(&text)?.with_origin(settings.origin.into()))
    }

    fn extensions(&self) -> &[&str] {
        &["graph.json"]
    }
}

type Waiting<'w, 's> = Query<'w, 's, (Entity, &'static PlansBy), (With<SurefootAgent>, Without<SurefootGraph>)>;

fn attach(agents: Waiting<'_, '_>, graphs: Res<'_, Assets<SurefootGraph>>, mut commands: Commands<'_, '_>) {
    for (agent, PlansBy(handle)) in &agents {
        if let Some(graph) = graphs.get(handle) {
            commands.entity(agent).insert(graph.clone());
        }
    }
}
