-- What planners share. Ids of graphs, levels and blobs are hashes of 32 bytes.

-- Graphs that were published, or that follow quickly from another.
CREATE TABLE graphs (
    id          bytea PRIMARY KEY CHECK (length(id) = 32),
    -- The request that asks for the graph (surefoot.planner.v1.StartBuildRequest), from which any planner makes it.
    recipe      bytea NOT NULL,
    -- Name of the blob with the graph; NULL if every planner makes it anew, as it does after an edit of the map.
    blob        bytea CHECK (length(blob) = 32),
    -- How long the stages of the build took, s: apart from the blob, which is the same whoever builds it.
    times       double precision[] NOT NULL,
    -- Fencing token of the claim under which it was published.
    token       bigint NOT NULL,
    built_at    timestamptz NOT NULL DEFAULT now(),
    used_at     timestamptz NOT NULL DEFAULT now()
);

-- Who builds which graph. A claim holds while the lease of its member does.
CREATE TABLE claims (
    graph       bytea PRIMARY KEY CHECK (length(graph) = 32),
    member      bigint NOT NULL,
    token       bigint NOT NULL,
    build       bigint NOT NULL
);

-- Builds as clients see them, of all planners.
CREATE TABLE operations (
    id              bigint PRIMARY KEY,
    recipe          bytea NOT NULL,
    -- The planner that runs it.
    member          bigint NOT NULL,
    -- Queued, map, vertices, probes, index; done, failed, cancelled.
    stage           smallint NOT NULL CHECK (stage BETWEEN 0 AND 7),
    probes_done     bigint NOT NULL,
    probes_total    bigint NOT NULL,
    graph           bytea,
    reason          text,
    message         text,
    is_cancelled    boolean NOT NULL DEFAULT false,
    -- Seconds since 1970.
    started         double precision NOT NULL,
    noted_at        timestamptz NOT NULL DEFAULT now()
);
CREATE INDEX open_operations ON operations (member) WHERE stage < 5;

-- Number of changes of the layers of each level.
CREATE TABLE level_versions (
    level       bytea PRIMARY KEY CHECK (length(level) = 32),
    version     bigint NOT NULL
);
CREATE TABLE layers (
    level       bytea NOT NULL REFERENCES level_versions,
    name        text NOT NULL,
    content     bytea NOT NULL,
    PRIMARY KEY (level, name)
);

-- Traversals that were reported, as sums.
CREATE TABLE evidence (
    graph               bytea NOT NULL REFERENCES graphs ON DELETE CASCADE,
    reporter            text NOT NULL,
    is_trusted          boolean NOT NULL,
    from_vertex         integer NOT NULL,
    to_vertex           integer NOT NULL,
    tries               bigint NOT NULL,
    successes           bigint NOT NULL,
    deaths              bigint NOT NULL,
    decisions           double precision NOT NULL,
    decisions_squared   double precision NOT NULL,
    PRIMARY KEY (graph, from_vertex, to_vertex, is_trusted, reporter)
);

-- Imported levels.
CREATE TABLE levels (
    map_hash    bytea PRIMARY KEY CHECK (length(map_hash) = 32),
    name        text NOT NULL,
    owner       text NOT NULL,
    blob        bytea NOT NULL CHECK (length(blob) = 32)
);
