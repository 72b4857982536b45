import "swagger-ui-dist/swagger-ui.css";
import SwaggerUIBundle from "swagger-ui-dist/swagger-ui-es-bundle.js";

/** The reference for people: Swagger UI on the service's own description, with nothing from anywhere else. */
SwaggerUIBundle({
  url: "/openapi.json",
  dom_id: "#reference",
  deepLinking: true,
  docExpansion: "list",
  displayRequestDuration: true,
  filter: true,
  validatorUrl: null, // it would send the description to a server elsewhere
  // what a signed-in browser tries out here counts as its own page's change
  requestInterceptor: (request) => {
    const headers = { ...(request.headers as Record<string, string> | undefined), "X-Groundplan-Session": "1" };
    return { ...request, headers };
  },
});
