"""Checks manifests, dashboard and alerts: SUREFOOT FOLDER-OF-RENDERED-LAYOUTS METRICS-URI..."""

import itertools
import json
import pathlib
import re
import subprocess
import sys
import urllib.request

import jsonschema
import kubernetes_validate
import promql_parser
import yaml

DEPLOY = pathlib.Path(__file__).parent
# The oldest and the newest Kubernetes that manifests are checked for.
VERSIONS = ["1.30", "1.37"]
# Kinds of Agones and of KEDA, whose schemas are their own.
FOREIGN = ["Fleet", "FleetAutoscaler", "ScaledObject"]
FOREIGN = {kind: json.loads((DEPLOY / "schemas" / f"{kind.lower()}.json").read_text()) for kind in FOREIGN}
# What the Secret of a fleet holds, of the form that docs/guides/kubernetes.md says.
SECRETS = {
    "store": "postgres://surefoot:secret@postgres:5432/surefoot",
    "role": "surefoot",
    "blobs": "s3://surefoot/blobs",
    "nats": "nats://nats:4222",
}
# What Helm adds to a manifest, by path.
OF_HELM = {
    "metadata.namespace",
    "metadata.labels.app.kubernetes.io/managed-by",
    "metadata.labels.app.kubernetes.io/instance",
    "metadata.annotations.helm.sh/hook",
    "metadata.annotations.helm.sh/hook-delete-policy",
    "spec.template.spec.containers.surefoot.imagePullPolicy",
}
# Seconds that a service needs to end after SIGTERM, with room: five of drain and four of saving.
END_SECONDS = 15
# Prometheus makes these itself.
OWN_METRICS = {"up"}
errors = []


def closed(schema):
    """The schema without room for fields that it does not name: Kubernetes would drop them silently."""
    if isinstance(schema, list):
        return [closed(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    schema = {key: closed(value) for key, value in schema.items()}
    if schema.get("type") == "object" and isinstance(schema.get("properties"), dict):
        schema.setdefault("additionalProperties", False)
    return schema


def check_schema(where, item):
    kind = item["kind"]
    if kind not in FOREIGN:
        for version in VERSIONS:
            try:
                kubernetes_validate.validate(item, version, strict=True)
            except (kubernetes_validate.ValidationError, kubernetes_validate.InvalidSchemaError) as error:
                errors.append(f"{where}: {kind} {item['metadata']['name']}, Kubernetes {version}: {getattr(error, 'message', error)}")
        return
    body = {"spec": item["spec"]}
    for error in jsonschema.Draft4Validator(closed(FOREIGN[kind])).iter_errors(body):
        errors.append(f"{where}: {kind} {item['metadata']['name']}: {'.'.join(map(str, error.path))}: {error.message}")
    if kind == "Fleet":
        # The pod in it, by Kubernetes' own schema.
        pod = item["spec"]["template"]["spec"]["template"]
        pod = {"apiVersion": "v1", "kind": "Pod", "metadata": {"name": "pod", **pod["metadata"]}, "spec": pod["spec"]}
        check_schema(where, pod)


def pod_of(item):
    """The template of the pods that a resource makes."""
    if item["kind"] == "Fleet":
        return item["spec"]["template"]["spec"]["template"]
    return item["spec"].get("template") if item["kind"] in ("Deployment", "StatefulSet", "Job") else None


def help_of(surefoot, command):
    return subprocess.run([surefoot, *command, "--help"], capture_output=True, text=True, check=True).stdout


def check_container(where, container, helps, surefoot):
    command = tuple(itertools.takewhile(lambda argument: not argument.startswith("-"), container["args"]))
    if command not in helps:
        helps[command] = help_of(surefoot, command)
    known = set(re.findall(r"\[env: ([A-Z_0-9]+)[=\]]", helps[command]))
    variables = {}
    for variable in container["env"]:
        source = variable.get("valueFrom", {})
        if "secretKeyRef" in source:
            value = SECRETS[source["secretKeyRef"]["key"]]
        elif "fieldRef" in source:
            value = "pod-0"
        else:
            # Kubernetes fills in the variables before.
            value = re.sub(r"\$\((\w+)\)", lambda found: variables[found[1]], variable["value"])
        variables[variable["name"]] = value
    own = {variable["name"] for variable in container["env"] if "fieldRef" in variable.get("valueFrom", {})}
    for name in variables.keys() - known - own:
        errors.append(f"{where}: `surefoot {' '.join(command)}` knows no variable {name}")
    if "--print-config" in helps[command]:
        # Values: the program parses them. It reads no files yet.
        parsed = subprocess.run([surefoot, *container["args"], "--print-config"], env=variables, capture_output=True, text=True)
        if parsed.returncode != 0:
            errors.append(f"{where}: {parsed.stderr.strip()}")
    if "limits" not in container["resources"] or not {"cpu", "memory"} <= container["resources"]["requests"].keys():
        errors.append(f"{where}: requests and a limit of memory are missing")
    for mount in (value for value in variables.values() if value.startswith("/")):
        if not any(mount.startswith(volume["mountPath"]) for volume in container["volumeMounts"]):
            errors.append(f"{where}: {mount} lies on no volume")


def check_end_and_probes(what, item, items):
    """Liveness asks only whether a process answers, and pods behind a Service outlive its list of endpoints."""
    pod, labels = item["spec"]["template"]["spec"], item["spec"]["template"]["metadata"]["labels"]
    services = [other for other in items if other["kind"] == "Service"]
    for container in pod["containers"]:
        if container.get("ports"):
            for probe in ("startupProbe", "livenessProbe"):
                if "tcpSocket" not in container.get(probe, {}):
                    errors.append(f"{what}: {probe} must be a tcpSocket")
            if container.get("readinessProbe", {}).keys().isdisjoint({"grpc", "exec"}):
                errors.append(f"{what}: readinessProbe must ask for the health of the service")
        wait = container.get("lifecycle", {}).get("preStop", {}).get("sleep", {}).get("seconds", 0)
        if any(service["spec"]["selector"].items() <= labels.items() for service in services) and not wait:
            errors.append(f"{what}: a Service sends clients to it, so it needs preStop")
        if item["kind"] != "Job" and pod["terminationGracePeriodSeconds"] < wait + END_SECONDS:
            errors.append(f"{what}: terminationGracePeriodSeconds is too short")


def check_members(where, items):
    """Workers of a fleet know every planner, and servers that exist."""
    replicas = {item["metadata"]["name"]: item["spec"]["replicas"] for item in items if item["kind"] == "StatefulSet"}
    if "planner" not in replicas:
        return
    worker = next(item for item in items if item["kind"] == "Deployment" and item["metadata"]["name"] == "worker")
    variables = {it["name"]: it.get("value") for it in worker["spec"]["template"]["spec"]["containers"][0]["env"]}
    planners = {f"http://planner-{idx}.planners:7601" for idx in range(replicas["planner"])}
    if set(variables["SUREFOOT_PLANNER"].split(",")) != planners:
        errors.append(f"{where}: workers do not know the {replicas['planner']} planners")
    servers = {f"http://server-{idx}.servers:7600" for idx in range(replicas["server"])}
    if not set(variables["SUREFOOT_SERVER"].split(",")) <= servers:
        errors.append(f"{where}: workers know servers that do not exist")


def fields(value, path=""):
    """Each scalar of a manifest with its path. Items of lists go by their names, so that their order does not count."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from fields(inner, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        for idx, inner in enumerate(value):
            name = inner.get("mountPath", inner.get("name", idx)) if isinstance(inner, dict) else idx
            yield from fields(inner, f"{path}.{name}")
    else:
        yield path, value


def check_equal(where, chart, layout):
    """The chart, without values, says what kustomize says."""
    chart, layout = ({(it["kind"], it["metadata"]["name"]): dict(fields(it)) for it in items} for items in (chart, layout))
    for kind, name in chart.keys() ^ layout.keys():
        errors.append(f"{where}: only the chart or only kustomize has {kind} {name}")
    for kind, name in chart.keys() & layout.keys():
        ours, theirs = chart[kind, name], layout[kind, name]
        for path in (ours.keys() | theirs.keys()) - OF_HELM:
            if ours.get(path) != theirs.get(path):
                errors.append(f"{where}: {kind} {name}: {path} is {ours.get(path)!r} in the chart, {theirs.get(path)!r} in kustomize")


def check_names(where, items, helps, surefoot):
    """What one resource says of another."""
    named = {(item["kind"], item["metadata"]["name"]) for item in items}
    pods = [pod_of(item) for item in items if pod_of(item)]

    def selects(labels, what):
        if not any(labels.items() <= pod["metadata"]["labels"].items() for pod in pods):
            errors.append(f"{where}: {what} selects no pod")

    for item in items:
        kind, name, spec = item["kind"], item["metadata"]["name"], item.get("spec", {})
        what = f"{kind} {name}"
        if kind == "Service":
            selects(spec["selector"], what)
        if kind in ("NetworkPolicy", "PodDisruptionBudget"):
            selects(spec.get("podSelector", spec.get("selector"))["matchLabels"], what)
        if kind in ("HorizontalPodAutoscaler", "ScaledObject") and (spec["scaleTargetRef"]["kind"], spec["scaleTargetRef"]["name"]) not in named:
            errors.append(f"{where}: {what} scales nothing")
        if kind == "FleetAutoscaler":
            if ("Fleet", spec["fleetName"]) not in named:
                errors.append(f"{where}: {what} scales nothing")
            fleet = next(other for other in items if other["kind"] == "Fleet")["spec"]["template"]["spec"]
            counter = fleet["counters"].get(spec["policy"]["counter"]["key"])
            if counter is None:
                errors.append(f"{where}: {what} scales by a counter that the fleet does not declare")
            server = next(it for it in fleet["template"]["spec"]["containers"] if it["name"] == fleet["container"])
            worlds = next(int(it["value"]) for it in server["env"] if it["name"] == "SUREFOOT_MAX_WORLDS")
            if fleet["counters"]["worlds"]["capacity"] != worlds:
                errors.append(f"{where}: the counter of worlds and SUREFOOT_MAX_WORLDS differ")
            if set(fleet["counters"]) != {"worlds", "npcs"}:
                errors.append(f"{where}: the server reports the counters worlds and npcs, the fleet declares {sorted(fleet['counters'])}")
        pod = pod_of(item)
        if not pod:
            continue
        if kind not in ("Fleet", "Job") and not item["spec"]["selector"]["matchLabels"].items() <= pod["metadata"]["labels"].items():
            errors.append(f"{where}: {what} does not select its own pods")
        if kind != "Fleet":
            check_end_and_probes(f"{where}: {what}", item, items)
        volumes = {volume["name"] for volume in pod["spec"]["volumes"]}
        volumes |= {claim["metadata"]["name"] for claim in spec.get("volumeClaimTemplates", [])}
        for volume in pod["spec"]["volumes"]:
            claim = volume.get("persistentVolumeClaim")
            if claim and ("PersistentVolumeClaim", claim["claimName"]) not in named:
                errors.append(f"{where}: {what} claims {claim['claimName']}, which does not exist")
        for container in pod["spec"]["containers"]:
            check_container(f"{where}: {what}, container {container['name']}", container, helps, surefoot)
            for mount in container["volumeMounts"]:
                if mount["name"] not in volumes:
                    errors.append(f"{where}: {what} has no volume {mount['name']}")


def metrics_in(expression):
    """Names of the metrics in an expression, which must parse."""
    names = set()
    # Grafana fills this in.
    tree = promql_parser.parse(expression.replace("$__rate_interval", "5m").replace("$__range", "5m"))

    def visit(node):
        if isinstance(node, promql_parser.VectorSelector):
            names.add(node.name)
        if isinstance(node, promql_parser.MatrixSelector):
            names.add(node.vector_selector.name)
        for field in ("lhs", "rhs", "expr"):
            if isinstance(getattr(node, field, None), object) and getattr(node, field, None) is not None:
                visit(getattr(node, field))
        for argument in getattr(node, "args", None) or []:
            visit(argument)

    visit(tree)
    if not names:
        raise ValueError("no metric was found in it")
    return names


def expressions(value):
    """All values of `expr` in a document."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key == "expr":
                yield inner
            else:
                yield from expressions(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from expressions(inner)


def exported(uris):
    """Names of all samples that services export, from the types that they declare."""
    names = set()
    for uri in uris:
        text = urllib.request.urlopen(f"{uri}/metrics", timeout=10).read().decode()
        for name, kind in re.findall(r"^# TYPE (\S+) (\S+)$", text, re.M):
            names |= {f"{name}_bucket", f"{name}_sum", f"{name}_count"} if kind == "histogram" else {name}
    return names


def check_metrics(uris):
    known = exported(uris) | OWN_METRICS
    count = 0
    alerts = yaml.safe_load((DEPLOY / "monitoring" / "alerts.yml").read_text())
    for rule in (rule for group in alerts["groups"] for rule in group["rules"]):
        if not {"alert", "expr", "labels", "annotations"} <= rule.keys():
            errors.append(f"alerts.yml: {rule} is not an alert")
    for path, document in [
        ("alerts.yml", alerts),
        ("docs/grafana.json", json.loads((DEPLOY.parent.parent / "docs" / "grafana.json").read_text())),
    ]:
        for expression in expressions(document):
            count += 1
            try:
                for name in metrics_in(expression) - known:
                    errors.append(f"{path}: no service exports {name}")
            except ValueError as error:
                errors.append(f"{path}: `{expression}`: {error}")
    return count


def main():
    surefoot, rendered, *uris = sys.argv[1:]
    helps, layouts = {}, {}
    for path in sorted(pathlib.Path(rendered).glob("*.yaml")):
        items = layouts[path.stem] = [item for item in yaml.safe_load_all(path.read_text()) if item]
        for item in items:
            check_schema(path.name, item)
        check_names(path.name, items, helps, surefoot)
        check_members(path.name, items)
    version = subprocess.run([surefoot, "--version"], capture_output=True, text=True, check=True).stdout.split()[1]
    for name, items in layouts.items():
        images = {it["image"] for pod in filter(None, map(pod_of, items)) for it in pod["spec"]["containers"]}
        if not name.startswith("valued-") and images != {f"registry.example/surefoot:{version}"}:
            errors.append(f"{name}: the images are {images}, this program is version {version}")
    charts = [name for name in layouts if name.startswith("chart-")]
    for name in charts:
        check_equal(name, layouts[name], layouts[name.removeprefix("chart-")])
    count = sum(map(len, layouts.values()))
    expression_count = check_metrics(uris)
    if errors:
        sys.exit("\n".join(errors))
    print(f"{count} manifests and {expression_count} expressions are good")


main()
