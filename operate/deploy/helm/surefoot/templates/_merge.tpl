{{/*
Merges .patch into .base as kustomize does: objects by their keys, lists of objects by name or mountPath. Other values
are replaced, and null removes a key.
*/}}
{{- define "surefoot.merge" -}}
{{- $merged := deepCopy .base -}}
{{- range $key, $new := .patch -}}
{{- $old := get $merged $key -}}
{{- if kindIs "invalid" $new -}}
{{- $_ := unset $merged $key -}}
{{- else if and (kindIs "map" $new) (kindIs "map" $old) -}}
{{- $_ := set $merged $key (include "surefoot.merge" (dict "base" $old "patch" $new) | fromYaml) -}}
{{- else if and (kindIs "slice" $old) (has $key (list "containers" "env" "volumeMounts" "volumes")) -}}
{{- $by := ternary "mountPath" "name" (eq $key "volumeMounts") -}}
{{- $items := include "surefoot.merge-list" (dict "base" $old "patch" $new "by" $by) | fromYamlArray -}}
{{- $_ := set $merged $key $items -}}
{{- else -}}
{{- $_ := set $merged $key $new -}}
{{- end -}}
{{- end -}}
{{- toYaml $merged -}}
{{- end -}}

{{/* Merges the list .patch into .base: items of the same name (the key .by) become one. */}}
{{- define "surefoot.merge-list" -}}
{{- $by := .by -}}
{{- $merged := list -}}
{{- range $old := .base -}}
{{- $item := $old -}}
{{- range $new := $.patch -}}
{{- if eq (get $new $by) (get $old $by) -}}
{{- $item = include "surefoot.merge" (dict "base" $item "patch" $new) | fromYaml -}}
{{- end -}}
{{- end -}}
{{- $merged = append $merged $item -}}
{{- end -}}
{{- range $new := .patch -}}
{{- $is_new := true -}}
{{- range $old := $.base -}}
{{- if eq (get $new $by) (get $old $by) -}}
{{- $is_new = false -}}
{{- end -}}
{{- end -}}
{{- if $is_new -}}
{{- $merged = append $merged (include "surefoot.merge" (dict "base" dict "patch" $new) | fromYaml) -}}
{{- end -}}
{{- end -}}
{{- toYaml $merged -}}
{{- end -}}
