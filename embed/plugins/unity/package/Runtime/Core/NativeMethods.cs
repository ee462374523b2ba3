using System;
using System.Runtime.InteropServices;

namespace Surefoot
{
    /// <summary>
    /// The functions of surefoot.h, under its names. sf_agents_observe_with is left out: a managed function that the library calls must be
    /// static for ahead-of-time compilers and may not throw, and sf_agents_rays with sf_agents_observe does the same in two calls.
    /// </summary>
    internal static unsafe class NativeMethods
    {
#if !UNITY_EDITOR && (UNITY_IOS || UNITY_WEBGL)
        // These players link the static library.
        private const string Name = "__Internal";
#else
        private const string Name = "surefoot";
#endif

        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern IntPtr sf_version();
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern uint sf_abi_version();
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_body_default(Body* body, NativeError* error);

        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_policy_shipped(byte* name, out PolicyHandle policy, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_policy_load(byte* path, out PolicyHandle policy, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_policy_load_memory(void* manifest, UIntPtr manifestSize, void* weights, UIntPtr weightsSize, out PolicyHandle policy, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_policy_lengths(PolicyHandle policy, UIntPtr* observationLength, UIntPtr* memoryLength, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_policy_label(PolicyHandle policy, byte* label, UIntPtr capacity, UIntPtr* length, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern void sf_policy_destroy(IntPtr policy);

        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_create(PolicyHandle policy, Body* body, uint maxAgents, out AgentsHandle agents, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern void sf_agents_destroy(IntPtr agents);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_set_devices(AgentsHandle agents, Device* devices, UIntPtr count, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_begin(AgentsHandle agents, uint agent, ulong seed, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_set_goal(AgentsHandle agents, uint agent, Vec3 feet, Vec3 goal, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_note(AgentsHandle agents, uint agent, Vec3 feet, int* reached, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_locomotion_advance(Locomotion* locomotion, Body* body, CharacterState* state, AgentAction* action, Ability ability, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_rays(AgentsHandle agents, CharacterState* states, UIntPtr count, SightRay* rays, UIntPtr rayCapacity, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_arrival_rays(
            AgentsHandle agents, CharacterState* state, Vec3 goal, float radius, SightRay* rays, UIntPtr capacity,
            UIntPtr* count, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_has_arrived(
            AgentsHandle agents, CharacterState* state, Vec3 goal, float radius, SightHit* hits, int* arrived,
            NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_observe(AgentsHandle agents, uint* ids, CharacterState* states, SightHit* hits, UIntPtr count, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_observation(AgentsHandle agents, uint agent, float* values, UIntPtr capacity, UIntPtr* count, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_decide(AgentsHandle agents, uint* ids, UIntPtr count, float noiseShare, AgentAction* actions, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_acted(AgentsHandle agents, uint* ids, AgentAction* actions, UIntPtr count, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_progress(AgentsHandle agents, uint agent, Progress* progress, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_save(AgentsHandle agents, uint agent, void* bytes, UIntPtr capacity, UIntPtr* size, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_agents_restore(AgentsHandle agents, uint agent, void* bytes, UIntPtr size, NativeError* error);

        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_graph_load(byte* path, out GraphHandle graph, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_graph_load_memory(void* bytes, UIntPtr size, out GraphHandle graph, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern void sf_graph_destroy(IntPtr graph);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_graph_describe(GraphHandle graph, GraphInfo* info, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_graph_vertices(GraphHandle graph, Vec3* vertices, UIntPtr capacity, UIntPtr* count, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_graph_edges(GraphHandle graph, Edge* edges, UIntPtr capacity, UIntPtr* count, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_graph_frame(GraphHandle graph, LevelFrame* frame, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_graph_ability(GraphHandle graph, Ability ability, NativeAbilityInfo* info, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_graph_set_coordinates(GraphHandle graph, int coordinates, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_graph_set_edge_open(GraphHandle graph, uint from, uint to, int isOpen, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_graph_set_edge_price(GraphHandle graph, uint from, uint to, float factor, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_graph_edit(GraphHandle graph, Edit* edits, UIntPtr count, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_graph_note_traversals(GraphHandle graph, Traversal* traversals, UIntPtr count, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_graph_find_path(GraphHandle graph, NativeQuery* query, Leg* legs, UIntPtr capacity, UIntPtr* count, Plan* plan, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_graph_find_alternatives(GraphHandle graph, NativeQuery* query, Plan* plans, UIntPtr planCapacity, UIntPtr* planCount, Leg* legs, UIntPtr legCapacity, UIntPtr* legCount, NativeError* error);

        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_follower_create(Vec3 goal, out FollowerHandle follower, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_follower_create_on(GraphHandle graph, Vec3 goal, out FollowerHandle follower, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern void sf_follower_destroy(IntPtr follower);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_follower_copy(FollowerHandle from, FollowerHandle to, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_follower_advance(FollowerHandle follower, Vec3 feet, int reached, FollowStep* step, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_follower_move_goal(FollowerHandle follower, Vec3 goal, Vec3 feet, int reached, FollowStep* step, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_follower_plan(FollowerHandle follower, GraphHandle graph, Vec3 feet, float caution, uint without, FollowStep* step, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_follower_prepare(FollowerHandle follower, RehearsalsHandle rehearsals, AgentsHandle agents, uint agent, CharacterState* state, Vec3 origin, FollowStep* step, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_gait_named(byte* name, Gait* gait, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_follower_set_gait(FollowerHandle follower, Gait* gait, FollowStep* step, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_follower_note_death(FollowerHandle follower, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_follower_legs(FollowerHandle follower, Leg* legs, UIntPtr capacity, UIntPtr* count, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_follower_take_traversals(FollowerHandle follower, Traversal* traversals, UIntPtr capacity, UIntPtr* count, NativeError* error);

        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_rehearsals_create(PolicyHandle policy, MapHandle map, Body* body, uint threadCount, out RehearsalsHandle rehearsals, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern void sf_rehearsals_destroy(IntPtr rehearsals);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_rehearsals_set_blocks(RehearsalsHandle rehearsals, Block* blocks, UIntPtr count, NativeError* error);

        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_map_load(byte* path, out MapHandle map, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_map_load_memory(void* bytes, UIntPtr size, out MapHandle map, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern void sf_map_destroy(IntPtr map);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_map_extent(MapHandle map, Vec3* extent, Vec3* origin, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_map_frame(MapHandle map, LevelFrame* frame, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_frame_to_map(LevelFrame* frame, LevelPlace place, Vec3* onMap, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_frame_to_level(LevelFrame* frame, Vec3 place, LevelPlace* inLevel, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_map_devices(MapHandle map, Device* devices, UIntPtr capacity, UIntPtr* count, NativeError* error);

        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_world_create(MapHandle map, Body* body, out WorldHandle world, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern void sf_world_destroy(IntPtr world);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_world_spawn(WorldHandle world, Vec3 feet, float yaw, uint* npc, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_world_despawn(WorldHandle world, uint npc, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_world_set_goal(WorldHandle world, uint npc, Vec3 goal, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_world_decide(WorldHandle world, uint npc, AgentAction action, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_world_tick(WorldHandle world, ulong* tick, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_world_close_decision(WorldHandle world, uint npc, Outcome* outcome, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_world_step(WorldHandle world, uint* npcs, AgentAction* actions, Outcome* outcomes, UIntPtr count, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_world_state(WorldHandle world, uint npc, CharacterState* state, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_world_look(WorldHandle world, uint npc, SightHit* hits, UIntPtr capacity, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_world_cast_rays(WorldHandle world, SightRay* rays, UIntPtr count, SightHit* hits, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_world_observation(WorldHandle world, uint npc, float* values, UIntPtr capacity, UIntPtr* count, NativeError* error);

        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_snapshot_create(out SnapshotHandle snapshot, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern void sf_snapshot_destroy(IntPtr snapshot);

        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_world_save(WorldHandle world, SnapshotHandle snapshot, NativeError* error);
        [DllImport(Name, CallingConvention = CallingConvention.Cdecl)]
        internal static extern Status sf_world_restore(WorldHandle world, SnapshotHandle snapshot, NativeError* error);
    }
}
