# The front: nginx as a user without rights, with its configuration inside.
# docker build -f docker/front.Dockerfile .
ARG DIGEST=
FROM nginx:1.28-bookworm${DIGEST}
RUN install -d -o nginx -g nginx /etc/groundplan/tls
COPY docker/front/nginx.conf docker/front/start /etc/groundplan/
USER nginx
EXPOSE 8443
CMD ["/etc/groundplan/start"]
