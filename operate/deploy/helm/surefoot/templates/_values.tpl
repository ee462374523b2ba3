{{/* .item, a manifest, with what the values of .context say about it. */}}
{{- define "surefoot.valued" -}}
{{- $item := .item -}}
{{- $values := .context.Values -}}
{{- $own := get $values $item.metadata.name | default dict -}}
{{- $_ := set $item.metadata.labels "app.kubernetes.io/managed-by" .context.Release.Service -}}
{{- $_ := set $item.metadata.labels "app.kubernetes.io/instance" .context.Release.Name -}}
{{- if has $item.kind (list "Deployment" "StatefulSet" "Job") -}}
{{- $container := first $item.spec.template.spec.containers -}}
{{- $tag := $values.image.tag | default .context.Chart.AppVersion -}}
{{- $_ := set $container "image" (printf "%s:%s" $values.image.repository $tag) -}}
{{- $_ := set $container "imagePullPolicy" $values.image.pullPolicy -}}
{{- $env := list -}}
{{- if eq $item.metadata.name "worker" -}}
{{- range $service, $port := dict "server" 7600 "planner" 7601 -}}
{{- $addresses := list -}}
{{- range until (int (get $values $service).replicas) -}}
{{- $addresses = append $addresses (printf "http://%s-%d.%ss:%v" $service . $service $port) -}}
{{- end -}}
{{- if $addresses -}}
{{- $env = append $env (dict "name" (printf "SUREFOOT_%s" (upper $service)) "value" (join "," $addresses)) -}}
{{- end -}}
{{- end -}}
{{- end -}}
{{- range $key, $value := $own.env -}}
{{- $env = append $env (dict "name" $key "value" $value "valueFrom" nil) -}}
{{- end -}}
{{- $patch := dict "name" "surefoot" "env" $env -}}
{{- if $own.resources -}}
{{- $_ := set $container "resources" $own.resources -}}
{{- end -}}
{{- range list (dict "containers" (list $patch)) $own.pod -}}
{{- $spec := include "surefoot.merge" (dict "base" $item.spec.template.spec "patch" .) | fromYaml -}}
{{- $_ := set $item.spec.template "spec" $spec -}}
{{- end -}}
{{- if $own.replicas -}}
{{- $_ := set $item.spec "replicas" $own.replicas -}}
{{- end -}}
{{- end -}}
{{- if and (eq $item.kind "StatefulSet") $own.storage $item.spec.volumeClaimTemplates -}}
{{- $_ := set (first $item.spec.volumeClaimTemplates).spec.resources.requests "storage" $own.storage -}}
{{- else if and (eq $item.kind "PersistentVolumeClaim") $own.storage -}}
{{- $_ := set $item.spec.resources.requests "storage" $own.storage -}}
{{- else if eq $item.kind "HorizontalPodAutoscaler" -}}
{{- range list "minReplicas" "maxReplicas" -}}
{{- $_ := set $item.spec . (get $own . | default (get $item.spec .)) -}}
{{- end -}}
{{- else if and (eq $item.kind "ScaledObject") $own.enabled -}}
{{- $_ := set $item.spec "maxReplicaCount" ($own.maxReplicas | default $item.spec.maxReplicaCount) -}}
{{- $queue := (first $item.spec.triggers).metadata -}}
{{- $_ := set $queue "natsServerMonitoringEndpoint" $own.natsMonitoring -}}
{{- $missing := "prover.lane is missing: `surefoot prove --print-lane` prints it; or set prover.enabled to false" -}}
{{- $_ := set $queue "consumer" (printf "prove-%s" (required $missing $own.lane)) -}}
{{- else if eq $item.kind "Job" -}}
{{- /* It runs before servers and planners of this version start. */ -}}
{{- $hook := dict "helm.sh/hook" "pre-install,pre-upgrade" "helm.sh/hook-delete-policy" "before-hook-creation" -}}
{{- $_ := set $item.metadata "annotations" $hook -}}
{{- end -}}
{{- toYaml $item -}}
{{- end -}}
